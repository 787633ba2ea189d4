"""Finds the recipe with the lowest validation loss in a given time.

    python -m studies.benchmarks.training results/<run> [--experiment charts_occluded_touch] [--recipe fast]
        [--seconds 200 | --steps 1000] [--windows 1] [--validate-on results/<larger run>] [--seeds 0 1]
        [--variants NAME ...]

Each variant of `VARIANTS` (default: all), or one given as YAML, changes some keys of the recipe. Its steps are timed
first. Then it trains for as many steps as fit in the seconds of processor time on one core, or for --steps; the
schedule ends with the last. The run's stores must exist.

The last columns say how smooth the meshes of the model that is kept are (`palpate.learning.surface_quality`), the mean
over the validation windows. With few objects the validation loss is inaccurate: --validate-on uses the validation
objects of a larger run of the same config. Losses are on 2,500 points and --windows windows of each object, at
the best evaluation and at the last.
"""

import argparse
import logging
import os
import statistics
import tempfile
from itertools import product
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import torch
import yaml
from scipy.spatial import cKDTree

from palpate.configuration import merge
from palpate.experiments import Experiment, Experiments
from palpate.learning.checkpoints import load
from palpate.learning.data import ExperimentData
from palpate.learning.learners import ReconstructionLearner
from palpate.learning.loop import train
from palpate.learning.machine import Machine
from palpate.learning.recipes import Recipe, ReconstructionSettings
from palpate.learning.rows import QUALITY
from palpate.learning.samples import Assembler, windows
from palpate.learning.surface_quality import surface_quality, topology
from palpate.models import Reconstruction
from studies.training_steps import TrainingSteps

PROJECT = Path(__file__).parents[2]
TIMED = 6  # steps, after the same number of untimed ones
EVALUATIONS = 8

# Changes of the recipe by name: keys of `reconstruction`, merged over it.
VARIANTS = yaml.safe_load(Path(__file__).with_name("variants.yaml").read_text())


def combine(own: ExperimentData, larger: ExperimentData) -> ExperimentData:
    """The training objects of one run and the validation objects of the other."""
    chosen = [(own, own.of_split("train")), (larger, larger.of_split("validation"))]
    arrays = {name: np.concatenate([data[name][rows] for data, rows in chosen]) for name in own.arrays}
    for name, column in {"object": "objects", "class": "classes", "split": "splits"}.items():
        arrays[name] = [getattr(data, column)[row] for data, rows in chosen for row in rows]
    return ExperimentData(arrays, sensor=own.sensor)


@torch.no_grad()
def smoothness(model: Reconstruction, data: ExperimentData, experiment: Experiment, count: int) -> np.ndarray:
    """The numbers of `QUALITY` of a model's meshes, on average over so many windows of every validation object."""
    assemble, surface = Assembler(data, experiment), topology(experiment.plan.start)
    qualities = [
        surface_quality(model(assemble([sample]))[0].numpy(), surface, cKDTree(data["points"][sample.object]))
        for sample in windows(data, experiment, "validation")
        if sample.window < count
    ]
    return np.mean(qualities, axis=0)


def main() -> None:
    """Print a table with a row for each variant and seed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path)
    parser.add_argument("--experiment", default="charts_occluded_touch")
    parser.add_argument("--seconds", type=float, default=200)
    parser.add_argument("--steps", type=int)
    parser.add_argument("--windows", type=int, default=1)
    parser.add_argument("--validate-on", type=Path)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--recipe", default="fast")
    parser.add_argument("--variants", nargs="+", default=list(VARIANTS), help="names of VARIANTS, or YAML")
    args = parser.parse_args()
    logging.basicConfig(level=logging.WARNING)

    schemas = PROJECT / "workflow/schemas"
    declared = Experiments.read(PROJECT / "config/experiments.yaml", schemas / "experiments.schema.yaml")
    experiment = declared.experiments[args.experiment]
    recipe = Recipe.read(PROJECT / "config/recipes.yaml", args.recipe, {}, schemas / "recipes.schema.yaml")
    common = recipe.settings(experiment).row()
    data = ExperimentData.load(args.run, experiment, ("train", "validation"))
    if args.validate_on:
        data = combine(data, ExperimentData.load(args.validate_on, experiment, ["validation"]))
    torch.set_num_threads(1)
    print(
        f"{args.experiment}, {f'{args.steps} steps' if args.steps else f'{args.seconds:.0f} s'} of one core, "
        f"{len(data.of_split('train'))} objects to train on, {len(data.of_split('validation'))} to validate on, "
        f"seeds {args.seeds}"
    )
    columns = ["variant", "parameters", "ms a step", "steps", "best loss", "at step", "last loss", "training loss"]
    columns += QUALITY
    print(f"| {' | '.join(columns)} |\n{'|---' * len(columns)}|", flush=True)
    for name, seed in product(args.variants, args.seeds):
        settings = merge(common, VARIANTS.get(name) if name in VARIANTS else yaml.safe_load(name))
        settings |= {"validation_samples": args.windows, "validation_points": 2500, "epochs": None, "patience": None}

        def learner_of(seed: int, settings: dict):
            return ReconstructionLearner(data, experiment, ReconstructionSettings.from_row(settings), seed)

        (timed := learner_of(0, settings)).begin()
        step = TrainingSteps(timed)
        seconds = statistics.median([step(number) for number in range(2 * TIMED)][TIMED:])
        steps = args.steps or int(args.seconds / seconds)
        settings |= {"steps": steps, "evaluate_every": -(-steps // EVALUATIONS)}
        with tempfile.TemporaryDirectory() as folder:
            learner = learner_of(seed, settings)
            summary = train(learner, f"{folder}/model", f"{folder}/checkpoints", Machine("cpu"), name)
            rows = np.genfromtxt(f"{folder}/model/history.csv", delimiter=",", names=True)
            smooth = smoothness(load(f"{folder}/model/best.ckpt"), data, experiment, args.windows)
        at_best = rows[np.argmin(rows["validation_loss"])]
        losses = at_best["validation_loss"], rows["validation_loss"][-1], rows["train_loss"][-1]
        best, last, of_training = (f"{loss:.2f}" for loss in losses)
        cells = [name, f"{summary['parameters']:,}", f"{1e3 * seconds:.0f}", steps, best, int(at_best["step"]), last]
        cells += [of_training, *(f"{quality:.1f}" for quality in smooth)]
        print(f"| {' | '.join(map(str, cells))} |", flush=True)


if __name__ == "__main__":
    main()
