"""The run's objects.

catalogue.csv    the rows of catalogue/<batch>.csv, batch by batch, with their splits
"""

from workflow.run.job import log_to

from palpate import catalogue, seal
from palpate.text_files import read_record

log_to(snakemake.log[0])
params = snakemake.params
entries = [entry for path in snakemake.input.batches for entry in catalogue.read_catalogue(path)]
entries = [entry._replace(split=params.given.get(entry.object, "")) for entry in entries]
facts = [each for path in snakemake.input.facts for each in read_record(path).items()]
shapes = {name: each["shape"] for name, each in facts}
groups = catalogue.copies({entry.object: entry.checksum for entry in entries}, shapes)
splits = catalogue.splits_of(entries, params.split, params.seed, groups)
entries = [entry._replace(split=splits[entry.object]) for entry in entries]
made_from = seal.made_of(snakemake.input, seal.by_path({"split": params.split, "seed": params.seed}))
catalogue.write_catalogue(snakemake.output.table, entries, made_from)
