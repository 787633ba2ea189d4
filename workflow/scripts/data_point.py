"""figures/data_point.png: one grasp as the paper's dataset figure."""

from palpate import Dataset
from palpate.atomic import atomic_write
from palpate.batch import log_to
from palpate.results import dataset_figures as figures

log_to(snakemake.log[0])
with atomic_write(snakemake.output.figure) as path:
    figures.data_point(Dataset("."), path)
