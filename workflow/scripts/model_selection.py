"""tables/model_selection.csv (.md, .tex): Chamfer distance (m^2 x 9000) of twelve models by class."""

from palpate.batch import log_to
from palpate.results import errors
from palpate.results import model_tables as tables

log_to(snakemake.log[0])
evaluations = errors.read(snakemake.input.evaluations)
tables.write_table(tables.model_selection(evaluations, **snakemake.params.setup), snakemake.output.table)
