"""The run's objects.

catalogue.csv    the rows of catalogue/<batch>.csv, batch by batch
"""

from workflow.run.job import log_to

import logging
from collections import Counter
from pathlib import Path

from palpate import catalogue, configuration

log_to(snakemake.log[0])
entries = [entry for path in snakemake.input.batches for entry in catalogue.read_catalogue(path)]
if snakemake.params.by_name:  # splits that a user gives stay
    entries = catalogue.join_copies(entries)
schema = Path(snakemake.scriptdir).parent / "schemas/catalogue.schema.yaml"
configuration.check([dict(zip(catalogue.COLUMNS, entry, strict=True)) for entry in entries], schema, "catalogue.csv")
counts = Counter(entry.class_name for entry in entries)
of_classes = ((entry.class_name, entry.split) for entry in entries)
for name, splits in catalogue.empty_splits(of_classes, snakemake.params.split).items():
    logging.warning("class %s: none of its %d objects is in %s", name, counts[name], " or ".join(splits))
catalogue.write_catalogue(snakemake.output.table, entries)
