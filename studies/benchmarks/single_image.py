"""Processor time of a training step of every experiment of the single-image table, and the steps for equal time.

    python -m studies.benchmarks.single_image results/<run> [--recipe fast] [--steps 40] [--override YAML]
    python -m studies.benchmarks.single_image results/<run> --limits     what true cells and true points score

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

from palpate import Dataset
from palpate.charts import sample_faces
from palpate.evaluation.evaluate import POINTS
from palpate.evaluation.metrics import score, seeded
from palpate.experiments import Experiments
from palpate.inference.data import ExperimentData
from palpate.inference.inputs import INPUTS
from palpate.models.single_image import grid_surface, occupied
from palpate.protocol import pixel2mesh_chamfer
from palpate.training.learners import ReconstructionLearner
from palpate.training.recipes import Recipe
from studies.training_steps import TrainingSteps

PROJECT = Path(__file__).parents[2]
OURS = "single_image"
LEVELS, COUNTS = (0.4, 0.5, 0.7, 0.9), (1024, 1481)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path)
    parser.add_argument("--recipe", default="fast")
    parser.add_argument("--steps", type=int, default=40, help="the first quarter warms up")
    parser.add_argument("--override", type=yaml.safe_load, default={}, help="of the recipe, as training.override")
    parser.add_argument("--limits", action="store_true", help="score the truth as these networks represent it")
    args = parser.parse_args()
    torch.set_num_threads(1)
    print(tabulate(*(limits(args.run) if args.limits else step_times(args)), "github"))


def step_times(args: argparse.Namespace) -> tuple[list[tuple], tuple]:
    """Rows and headers of the table of steps."""
    schemas = PROJECT / "workflow/schemas"
    declared = Experiments.read(PROJECT / "config/experiments.yaml", schemas / "experiments.schema.yaml")
    experiments = declared.tables["single_image"].by_name
    recipe = Recipe.read(PROJECT / "config/recipes.yaml", args.recipe, args.override, schemas / "recipes.schema.yaml")
    data = ExperimentData.load(args.run, experiments[OURS], ("train", "validation"))
    steps = {}
    for name, experiment in experiments.items():
        learner = ReconstructionLearner(data, experiment, recipe.settings(experiment), 0)
        learner.on_fit_start()
        steps[name] = TrainingSteps(learner)
    # An object's tree, normals and cells are made once, in its first step: here before all.
    truth = steps[OURS].learner.truth
    for derive in (truth.trees, truth.normals, truth.occupied):
        derive(data.of_split("train"))
    for each in steps.values():
        each.learner.truth = truth
    seconds = {name: [] for name in steps}
    for number in range(args.steps):
        for name, each in steps.items():
            seconds[name].append(each(number))
    middle = {name: statistics.median(times[len(times) // 4 :]) for name, times in seconds.items()}
    rows = []
    for name, each in steps.items():
        parameters = sum(weights.numel() for weights in each.learner.model.parameters())
        rows.append((name, f"{parameters:,}", f"{1e3 * middle[name]:.0f}", f"{middle[OURS] / middle[name]:.2f}"))
    return rows, ("experiment", "parameters", "ms a step", "steps for equal time")


def limits(run: Path) -> tuple[list[tuple], tuple]:
    """Scores of true cells and of some of the true points, by the table's protocol, averaged over the objects."""
    points = [item for item in INPUTS if item.name == "points"]
    data = ExperimentData.read(Dataset(run, [points[0].stage]), points, ["validation"])
    scores: dict[str, list[tuple]] = {}
    for points in torch.from_numpy(data["points"]):
        cells, order = occupied(points).numpy(), torch.randperm(len(points), generator=seeded(0, "limits"))
        for level in LEVELS:
            vertices, faces = map(torch.from_numpy, grid_surface(cells, level))
            sampled = sample_faces(vertices[None], faces, POINTS, seeded(0, "limits"))[0]
            scores.setdefault(f"cells, level {level}", []).append(score(sampled, points))
        some, others = points[order[: len(order) // 2]], points[order[len(order) // 2 :]]
        for count in COUNTS:
            scores.setdefault(f"{count} points, against {len(others)} others", []).append(score(some[:count], others))
    means = {name: torch.tensor(found, dtype=torch.float64).mean(dim=0).tolist() for name, found in scores.items()}
    rows = [(name, f"{pixel2mesh_chamfer(d):.3f}", f"{one:.1f}", f"{two:.1f}") for name, (d, one, two) in means.items()]
    return rows, ("truth", "Chamfer distance", "F1 at tau", "F1 at 2 tau")


if __name__ == "__main__":
    main()
