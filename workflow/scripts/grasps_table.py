"""tables/grasps.csv (.md, .tex): Chamfer distance (m^2 x 9000) with 1 to 5 grasps."""

from palpate.batch import log_to
from palpate.results import errors
from palpate.results import model_tables as tables

log_to(snakemake.log[0])
evaluations = errors.read(snakemake.input.evaluations)
tables.write_table(tables.grasps(evaluations, **snakemake.params.setup), snakemake.output.table)
