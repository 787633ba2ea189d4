"""All checks of all batches, and those that need the whole run (no object in two splits, nothing lost).

reports/validation.csv    check, store, batch, objects, worst, limit, passed, where
"""

from palpate.atomic import atomic_write
from palpate.batch import log_to
from palpate.dataset import validation

log_to(snakemake.log[0])
with atomic_write(snakemake.output.table) as path:
    validation.combine_validation(
        snakemake.input.batches, catalogue=snakemake.input.catalogue, rejected=snakemake.input.rejected
    ).to_csv(path, index=False)
