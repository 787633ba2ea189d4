"""The run's objects.

catalogue.csv    the rows of catalogue/<batch>.csv, batch by batch
"""

from workflow.run.job import log_to

from pathlib import Path

from palpate import catalogue, configuration

log_to(snakemake.log[0])
entries = [entry for path in snakemake.input.batches for entry in catalogue.read_catalogue(path)]
if snakemake.params.by_name:  # splits that a user gives stay
    entries = catalogue.join_copies(entries)
schema = Path(snakemake.scriptdir).parent / "schemas/catalogue.schema.yaml"
configuration.check([dict(zip(catalogue.COLUMNS, entry, strict=True)) for entry in entries], schema, "catalogue.csv")
catalogue.write_catalogue(snakemake.output.table, entries)
