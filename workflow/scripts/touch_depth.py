"""The U-Net from a touch reading to depth.

models/touch_depth/best.ckpt        the weights with the lowest validation loss, and their settings
models/touch_depth/history.csv      step, seconds, train_loss, validation_loss, rate (9000 x m^2)
models/touch_depth/training.json    settings, steps, losses, machine

Work in progress is in checkpoints/touch_depth/, so that an interrupted training goes on.
"""

from pathlib import Path

from palpate import training
from palpate.batch import log_to

log_to(snakemake.log[0])
read = [
    training.read_touches(snakemake.input.touch, snakemake.input.catalogue, split) for split in ("train", "validation")
]
training.train(
    training.TouchDepthLearner(*read, snakemake.params.settings, snakemake.params.seed),
    Path(snakemake.output.model).parent,
    "checkpoints/touch_depth",
    training.Machine(**snakemake.params.machine, threads=snakemake.threads),
    "touch_depth",
)
