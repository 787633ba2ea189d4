"""tables/input_modalities.csv (.md, .tex): Chamfer distance (m^2 x 9000) with different inputs."""

from palpate.batch import log_to
from palpate.results import errors
from palpate.results import model_tables as tables

log_to(snakemake.log[0])
evaluations = errors.read(snakemake.input.evaluations)
tables.write_table(tables.input_modalities(evaluations, **snakemake.params.setup), snakemake.output.table)
