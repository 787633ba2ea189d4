"""tables/claims.csv (.md, .tex): what this run says about each claim of the paper that a number decides."""

from palpate.catalogue import log_to
from palpate.evaluation import claims, errors, tables

log_to(snakemake.log[0])
decided = claims.decide(
    errors.read(snakemake.input.evaluations),
    errors.read(snakemake.input.rings, errors.RING_COLUMNS),
    errors.read([snakemake.input.touches], errors.TOUCH_COLUMNS),
    snakemake.params.resamples,
)
tables.write_table(decided, snakemake.output.table)
