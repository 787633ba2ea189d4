"""One training of the grid of hyperparameters, rate~<r>/cnn_layers~<c>/gcn_layers~<g>/width~<w>.

tuning/<point>/best.ckpt        the weights with the lowest validation loss, and how they were trained
tuning/<point>/history.csv      step, seconds, train_loss, validation_loss, rate: losses 9000 x Chamfer, m^2
tuning/<point>/training.json    settings, steps, best step and loss, seconds, machine
"""

from pathlib import Path

from palpate import training
from palpate.batch import log_to
from palpate.training import checkpoints, tuning

log_to(snakemake.log[0])
experiment, folder = snakemake.params.experiment, Path(snakemake.output.model).parent
layers = checkpoints.architecture(experiment, snakemake.params.settings)
settings = tuning.point_settings(snakemake.params.settings, layers, snakemake.params.point, snakemake.params.steps)
pack = training.Pack.read(snakemake.input.pack, ("train", "validation"))
training.train(
    training.ReconstructionLearner(pack, experiment, settings, snakemake.params.seed),
    folder,
    Path("checkpoints") / folder,
    training.Machine(**snakemake.params.machine, threads=snakemake.threads),
    str(folder),
)
