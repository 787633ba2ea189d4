"""All checks of all batches, and those that need the whole run (no object in two splits, nothing lost).

reports/validation.csv    check, store, batch, objects, worst, limit, passed, where
"""

from palpate import store
from palpate.catalogue import log_to

log_to(snakemake.log[0])
with store.whole(snakemake.output.table) as path:
    store.combine_validation(
        snakemake.input.batches, catalogue=snakemake.input.catalogue, rejected=snakemake.input.rejected
    ).to_csv(path, index=False)
