"""One reconstruction model.

models/<experiment>/seed-<k>/best.ckpt        the weights with the lowest validation loss, and their settings
models/<experiment>/seed-<k>/history.csv      step, seconds, train_loss, validation_loss, rate (9000 x m^2)
models/<experiment>/seed-<k>/training.json    experiment, architecture, settings, steps, losses, machine

Work in progress is in checkpoints/<experiment>/seed-<k>/, so that an interrupted training goes on.
"""

import logging
from pathlib import Path

from palpate import scene, training
from palpate.batch import log_to

log = logging.getLogger(__name__)
log_to(snakemake.log[0])
experiment, seed = snakemake.wildcards.experiment, int(snakemake.wildcards.seed)
plan = scene.plan("experiment", **snakemake.params.experiment)
log.info("%s", plan)
pack = training.Pack.read(snakemake.input.pack, ("train", "validation"))
training.train(
    training.ReconstructionLearner(pack, snakemake.params.experiment, snakemake.params.settings, seed, plan),
    Path(snakemake.output.model).parent,
    f"checkpoints/{experiment}/seed-{seed}",
    training.Machine(**snakemake.params.machine, threads=snakemake.threads),
    f"{experiment} seed {seed}",
)
