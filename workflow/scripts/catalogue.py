"""The run's objects.

catalogue.csv    the rows of catalogue/<batch>.csv, batch by batch
"""

from workflow.run.job import log_to

import logging
from pathlib import Path

import pandas as pd

from palpate import catalogue, configuration
from palpate.atomic import atomic_write

log_to(snakemake.log[0])
entries = [entry for path in snakemake.input.batches for entry in catalogue.read_catalogue(path)]
if snakemake.params.by_name:  # splits that a user gives stay
    entries = catalogue.join_copies(entries)
table = pd.DataFrame(entries).set_axis(catalogue.COLUMNS, axis=1)
schema = Path(snakemake.scriptdir).parent / "schemas/catalogue.schema.yaml"
configuration.check(table.to_dict("records"), schema, "catalogue.csv")
of_classes = zip(table["class"], table["split"], strict=True)
for name, splits in catalogue.empty_splits(of_classes, snakemake.params.split).items():
    logging.warning("class %s: none of its %d objects is in %s", name, sum(table["class"] == name), " or ".join(splits))
with atomic_write(snakemake.output.table, checksum=True) as partial:
    table.to_csv(partial, index=False)
