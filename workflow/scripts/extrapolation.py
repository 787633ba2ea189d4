"""tables/extrapolation.csv (.md, .tex): error in square rings around each touch, m^2 and m^2 x 9000."""

from palpate.batch import log_to
from palpate.results import errors
from palpate.results import model_tables as tables

log_to(snakemake.log[0])
evaluations = errors.read(snakemake.input.evaluations, errors.RING_COLUMNS)
tables.write_table(tables.extrapolation(evaluations, **snakemake.params.setup), snakemake.output.table)
