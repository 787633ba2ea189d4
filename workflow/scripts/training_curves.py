"""figures/training_curves.png: loss of every training against its run time."""

from palpate.catalogue import log_to
from palpate.evaluation import figures
from palpate.store import whole

log_to(snakemake.log[0])
trainings = (tuple(training) for training in snakemake.params.trainings)
histories = dict(zip(trainings, snakemake.input.histories, strict=True))
with whole(snakemake.output.figure) as path:
    figures.training_curves(histories, snakemake.params.experiments, path)
