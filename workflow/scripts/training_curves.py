"""figures/training_curves.png: loss of every training against its run time."""

from palpate.atomic import atomic_write
from palpate.batch import log_to
from palpate.results import model_figures as figures

log_to(snakemake.log[0])
trainings = (tuple(training) for training in snakemake.params.trainings)
histories = dict(zip(trainings, snakemake.input.histories, strict=True))
with atomic_write(snakemake.output.figure) as path:
    figures.training_curves(histories, snakemake.params.experiments, path)
