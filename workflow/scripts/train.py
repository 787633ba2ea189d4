"""One model: of an experiment, of a point of the grid of hyperparameters, or the U-Net from readings to depth.

<folder>/best.ckpt        the last weights, or by a constant rate those with the lowest validation loss; their settings
<folder>/history.csv      step, seconds, train_loss, validation_loss, rate: losses 9000 x Chamfer, m^2
<folder>/training.json    experiment, architecture, settings, steps, step and loss of best.ckpt, seconds, machine

The folder is models/<experiment>/seed-<k>, tuning/rate~<r>/cnn_layers~<c>/gcn_layers~<g>/width~<w>, or
models/touch_depth. Work in progress is in checkpoints/<the same>, so that an interrupted training resumes.
"""

from workflow.run.job import log_to

from pathlib import Path

from palpate import Dataset, seal
from palpate.experiments import Experiment
from palpate.learning.data import ExperimentData
from palpate.learning.learners import ReconstructionLearner, TouchDepthLearner
from palpate.learning.loop import train
from palpate.learning.machine import Machine
from palpate.learning.recipes import ReconstructionSettings, TouchDepthSettings, tuning_settings
from palpate.learning.touch_charts import read_touches

log_to(snakemake.log[0])
params, folder = snakemake.params, Path(snakemake.output.model).parent
run = Path(snakemake.input.catalogue).parent
splits = ("train", "validation")
if params.get("experiment"):
    experiment = Experiment.from_row(snakemake.wildcards.get("experiment", ""), params.experiment)
    settings = ReconstructionSettings.from_row(params.settings)
    if params.get("point"):
        settings = tuning_settings(settings, params.point, params.steps)
    data = ExperimentData.load(run, experiment, splits, training=True)
    learner = ReconstructionLearner(data, experiment, settings, params.seed)
else:
    touches = [read_touches(Dataset(run, ["touch"]), split) for split in splits]
    learner = TouchDepthLearner(*touches, TouchDepthSettings(**params.settings), params.seed)
train(
    learner,
    folder,
    Path("checkpoints", *folder.parts[folder.parts[0] == "models" :]),
    Machine(**params.machine, threads=snakemake.threads),
    str(folder),
    seal.made_of(snakemake.input),
)
