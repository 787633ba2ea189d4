"""tables/claims.csv (.md, .tex): what this run says about each claim of the paper that a number decides."""

from palpate.batch import log_to
from palpate.results import claims, errors
from palpate.results import model_tables as tables

log_to(snakemake.log[0])
decided = claims.decide(
    errors.read(snakemake.input.evaluations),
    errors.read(snakemake.input.rings, errors.RING_COLUMNS),
    errors.read([snakemake.input.touches], errors.TOUCH_COLUMNS),
    snakemake.params.resamples,
)
tables.write_table(decided, snakemake.output.table)
