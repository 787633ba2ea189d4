"""The run's objects.

catalogue.csv    the rows of catalogue/<batch>.csv, batch by batch, with their splits
"""

from workflow.run.job import log_to

import json
from pathlib import Path

from palpate import catalogue, configuration

log_to(snakemake.log[0])
params = snakemake.params
entries = [entry for path in snakemake.input.batches for entry in catalogue.read_catalogue(path)]
entries = [entry._replace(split=params.given.get(entry.object, "")) for entry in entries]
facts = [each for path in snakemake.input.facts for each in json.loads(Path(path).read_text()).items()]
shapes = {name: each["shape"] for name, each in facts}
groups = catalogue.copies({entry.object: entry.checksum for entry in entries}, shapes)
splits = catalogue.splits_of(entries, params.split, params.seed, groups)
entries = [entry._replace(split=splits[entry.object]) for entry in entries]
schema = Path(snakemake.scriptdir).parent / "schemas/catalogue.schema.yaml"
configuration.check([dict(zip(catalogue.COLUMNS, entry, strict=True)) for entry in entries], schema, "catalogue.csv")
catalogue.write_catalogue(snakemake.output.table, entries)
