"""tables/grasps.csv (.md, .tex): Chamfer distance (m^2 x 9000) with 1 to 5 grasps."""

from palpate.catalogue import log_to
from palpate.evaluation import errors, tables

log_to(snakemake.log[0])
evaluations = errors.read(snakemake.input.evaluations)
tables.write_table(tables.grasps(evaluations, **snakemake.params.setup), snakemake.output.table)
