"""tables/single_image.csv (.md, .tex): reconstruction from single images, Pixel2Mesh's protocol."""

from palpate.batch import log_to
from palpate.results import errors
from palpate.results import model_tables as tables

log_to(snakemake.log[0])
evaluations = errors.read(snakemake.input.evaluations)
tables.write_table(tables.single_image(evaluations, **snakemake.params.setup), snakemake.output.table)
