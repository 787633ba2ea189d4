"""Errors of a trained model on objects that it was not trained on, for each experiment that is evaluated with it.

evaluations/<experiment>/seed-<k>.csv          a row a sample: experiment, seed, object, class, split, window, chamfer
                                               (m^2 x 9000), f1_tau, f1_2tau (%, Pixel2Mesh's protocol), bend
                                               (degrees), folded (%), gap (mm), across (degrees;
                                               palpate.learning.surface_quality), seconds (of the prediction), steps
evaluations/rings/<experiment>/seed-<k>.csv    a row a sample, touch and ring of true surface around it: experiment,
                                               seed, object, class, split, window, grasp, sensor, ring (1..5), points,
                                               distance (mean squared, m^2, from these points to the prediction), steps
evaluations/selection/<experiment>/seed-<k>.csv
                                               a row an object, strategy and number of grasps that it chose:
                                               experiment, seed, object, class, split, strategy, grasps, stored (grasps
                                               to choose among), chamfer, steps
evaluations/touch_depth.csv                    a row a successful touch: object, class, split, grasp, sensor, cloud
                                               (Chamfer distance of the predicted local cloud, m^2 x 9000), chart (that
                                               of the chart fitted to it), steps

They are of the splits that tables need. steps are those of the training: 0 in retrieval, which has none.
"""

from workflow.run.job import log_to

from pathlib import Path

import pandas as pd
import torch

from palpate import Dataset, seal
from palpate.atomic import atomic_write
from palpate.experiments import Experiment
from palpate.learning import evaluate
from palpate.learning.checkpoints import load_touch_depth
from palpate.learning.data import ExperimentData
from palpate.learning.inputs import inputs as arrays_of
from palpate.learning.machine import Machine
from palpate.learning.selection import evaluate_selection

inputs, params, wildcards = snakemake.input, snakemake.params, snakemake.wildcards
run = Path(inputs.catalogue).parent


def measured() -> pd.DataFrame:
    if not params.get("experiments"):
        model = load_touch_depth(inputs.model).to(Machine(params.device).torch_device())
        steps = evaluate.training_steps(inputs.summary)
        return evaluate.evaluate_touch(model, steps, Dataset(run, ["touch", "charts"]), params.points, params.splits)
    frames, data, loaded = [], None, None
    for experiment in [Experiment.from_row(*row) for row in params.experiments]:
        splits = params.splits[experiment.name]
        if loaded != (needed := (arrays_of(experiment), splits)):
            data, loaded = ExperimentData.load(run, experiment, splits), needed
        frames.append(measured_as(experiment, data, splits))
    return pd.concat(frames)


def measured_as(experiment: Experiment, data: ExperimentData, splits: list[str]) -> pd.DataFrame:
    if experiment.is_trained:
        trained = evaluate.load(inputs.model, inputs.summary, experiment, int(wildcards.seed), params.device)
    else:
        trained = evaluate.retrieval(run, experiment, int(wildcards.seed))
    if inputs.get("rings"):
        return evaluate.evaluate_rings(trained, data, Dataset(run, ["touch", "rings"]), splits)
    if snakemake.rule == "evaluate_selection":
        return evaluate_selection(trained, data, splits, params.points)
    return evaluate.evaluate(trained, data, params.points, splits)


log_to(snakemake.log[0])
torch.set_num_threads(snakemake.threads)
made_with = {} if params.points is None else {"evaluation.points": params.points}
with atomic_write(snakemake.output.table, seal.made_of(inputs, made_with)) as path:
    measured().to_csv(path, index=False)
