"""Processor time of a training step of every experiment of the single-image table, and the steps for equal time.

    python -m studies.benchmarks.single_image results/<run> [--recipe fast] [--steps 40] [--override YAML]

The experiments take turns, a step each, so that other work on the machine slows all alike. `steps_factor` of
config/recipes.yaml is the last column. The run needs its stores `surface` and `views`.
"""

import argparse
import os
import statistics
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import torch
import yaml
from tabulate import tabulate

from palpate.experiments import Experiments
from palpate.learning.data import ExperimentData
from palpate.learning.learners import ReconstructionLearner
from palpate.learning.recipes import Recipe
from studies.training_steps import TrainingSteps

PROJECT = Path(__file__).parents[2]
OURS = "single_image"


def main() -> None:
    """Print a table with a row for each experiment."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path)
    parser.add_argument("--recipe", default="fast")
    parser.add_argument("--steps", type=int, default=40, help="the first quarter warms up")
    parser.add_argument("--override", type=yaml.safe_load, default={}, help="of the recipe, as training.override")
    args = parser.parse_args()
    torch.set_num_threads(1)
    schemas = PROJECT / "workflow/schemas"
    declared = Experiments.read(PROJECT / "config/experiments.yaml", schemas / "experiments.schema.yaml")
    experiments = declared.tables["single_image"].by_name
    recipe = Recipe.read(PROJECT / "config/recipes.yaml", args.recipe, args.override, schemas / "recipes.schema.yaml")
    data = ExperimentData.load(args.run, experiments[OURS], ("train", "validation"))
    steps = {}
    for name, experiment in experiments.items():
        learner = ReconstructionLearner(data, experiment, recipe.settings(experiment), 0)
        learner.begin()
        steps[name] = TrainingSteps(learner)
    # An object's tree, normals and cells are made once, in its first step: here before all.
    truth = steps[OURS].learner.truth
    for derive in (truth.trees, truth.normals, truth.occupied):
        derive(data.of_split("train"))
    for training in steps.values():
        training.learner.truth = truth
    seconds = {name: [] for name in steps}
    for number in range(args.steps):
        for name, step in steps.items():
            seconds[name].append(step(number))
    middle = {name: statistics.median(times[len(times) // 4 :]) for name, times in seconds.items()}
    rows = []
    for name, training in steps.items():
        parameters = sum(weights.numel() for weights in training.learner.model.parameters())
        rows.append((name, f"{parameters:,}", f"{1e3 * middle[name]:.0f}", f"{middle[OURS] / middle[name]:.2f}"))
    print(tabulate(rows, ("experiment", "parameters", "ms a step", "steps for equal time"), "github"))


if __name__ == "__main__":
    main()
