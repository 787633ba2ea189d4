"""The run's objects.

catalogue.csv            object, class, split, batch, source (from the source's path on), checksum (SHA-256), up,
                         scale, others
catalogue/<batch>.csv    the same rows, of one batch
"""

from pathlib import Path

from palpate import catalogue, configuration
from palpate.atomic import atomic_write
from palpate.batch import log_to

log_to(snakemake.log[0])
params = snakemake.params
table = catalogue.build(params.source, params.classes, params.split, params.batches)
configuration.check(table.to_dict("records"), params.schema, "catalogue.csv")
rows_of = dict(iter(table.groupby("batch")))
for path in map(Path, snakemake.output.batches):
    with atomic_write(path, checksum=True) as partial:
        rows_of[path.stem].to_csv(partial, index=False)
with atomic_write(snakemake.output.catalogue, checksum=True) as partial:
    table.to_csv(partial, index=False)
