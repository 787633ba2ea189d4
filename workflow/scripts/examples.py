"""figures/examples_<class>.png: a sheet of a class's objects, their images, readings and touch sites."""

from palpate import Dataset
from palpate.atomic import atomic_write
from palpate.batch import log_to
from palpate.results import dataset_figures as figures

log_to(snakemake.log[0])
with atomic_write(snakemake.output.figure) as path:
    figures.examples(Dataset("."), snakemake.wildcards.name, path)
