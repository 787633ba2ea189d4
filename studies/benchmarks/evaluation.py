"""Errors of evaluations, and their run time.

    python -m studies.benchmarks.evaluation results/small [--objects N] [--experiment NAME ...]

Prints, for objects of a run that has been built:

- the scores of a perfect prediction (the true mesh), which are the error of sampling, by number of points, for the
  Chamfer distance and for rings, with their times;
- the coverage of the 95 % intervals in simulated runs, by objects a class and seeds;
- with --experiment, the processor time that an evaluation of these trained models takes, and that of the paper's 433
  objects with five windows each.
"""

import argparse
import os
import time

os.environ.setdefault("OMP_NUM_THREADS", "1")

from pathlib import Path

import numpy as np
import pandas as pd
import torch

from palpate import Dataset
from palpate.charts import build_tree, sample_faces
from palpate.evaluation.evaluate import evaluate, load
from palpate.evaluation.metrics import score, seeded
from palpate.evaluation.rings import CloudSurface, MeshSurface, ring_distances, ring_points
from palpate.inference import checkpoints
from palpate.inference.data import ExperimentData
from palpate.mesh import OBJECT_POSITION, load_visual
from palpate.protocol import RINGS
from palpate.results.bootstrap import interval

POINTS = (1_000, 3_000, 10_000, 30_000)
RUNS = 400  # simulated for each coverage
SAMPLES_OF_THE_PAPER = (258 + 175) * 5  # validation and test objects (supplement, Dataset Statistics), windows


def select_objects(run: str, number: int) -> list:
    """The same number of objects of each class, evenly spaced."""
    dataset = Dataset(run)
    classes = [dataset.of_class(name) for name in dataset.classes]
    return [members[k * len(members) // number] for members in classes for k in range(number)]


def surface(item) -> tuple[torch.Tensor, torch.Tensor]:
    """Vertices (1, V, 3), world frame, and faces (F, 3) of an object's mesh."""
    mesh = load_visual(item.mesh)
    vertices = torch.from_numpy(np.asarray(mesh.vertices) + OBJECT_POSITION).float()
    return vertices[None], torch.from_numpy(np.asarray(mesh.faces)).long()


def sampling_error(items: list) -> pd.DataFrame:
    """Chamfer distance of points sampled on the true mesh to the true cloud, by their number: mean over objects."""
    rows = []
    for item in items:
        # Interior faces of a mesh are not part of its exterior: the reference is the cloud.
        truth = torch.from_numpy(item.points)
        shuffled = truth[torch.randperm(len(truth), generator=seeded(0, item.name))]
        half = shuffled[: len(truth) // 2]
        mesh = surface(item)
        for count in POINTS:
            draw = sample_faces(*mesh, count, seeded(0, item.name, "benchmark"))[0]
            start = time.perf_counter()
            chamfer = score(draw, truth, build_tree(truth)).chamfer
            seconds = time.perf_counter() - start
            rows.append({"class": item.class_name, "points": count, "chamfer": chamfer, "ms": 1000 * seconds})
        floor = score(half, shuffled[len(half) :]).chamfer / 2  # of half the points: twice the floor of all
        rows.append({"class": item.class_name, "points": 0, "chamfer": floor, "ms": np.nan})
    table = pd.DataFrame(rows).groupby("points")[["chamfer", "ms"]].mean()
    return table.rename(index={0: "cloud against cloud, 10000"})


def ring_error(items: list) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Ring distances of the true mesh, by number of points sampled; and mesh and cloud compared as surfaces."""
    rows, surfaces = [], []
    for item in items:
        mesh, cloud = MeshSurface(load_visual(item.mesh), OBJECT_POSITION), CloudSurface(item.points)
        predictions = {n: sample_faces(*surface(item), n, seeded(0, item.name))[0] for n in POINTS}
        trees = {count: build_tree(points) for count, points in predictions.items()}
        for grasp in item.grasps:
            for sensor in np.flatnonzero(grasp.success):
                pose = grasp.position[sensor], grasp.rotation[sensor]
                start = time.perf_counter()
                depth = mesh.project(*pose)
                middle = time.perf_counter()
                other = cloud.project(*pose)
                end = time.perf_counter()
                both = np.isfinite(depth) & np.isfinite(other)
                met = {"mesh ms": 1000 * (middle - start), "cloud ms": 1000 * (end - middle)}
                met["median difference, mm"] = 1000 * np.median(np.abs(depth[both] - other[both]))
                surfaces.append(met | {"met, mesh": np.isfinite(depth).mean(), "met, cloud": np.isfinite(other).mean()})
                points = ring_points(depth, *pose)
                for count in POINTS:
                    found = ring_distances(points, predictions[count], trees[count])
                    rows.append({"points": count, **dict(zip(RINGS, found, strict=True))})
    return pd.DataFrame(rows).groupby("points").mean(), pd.DataFrame(surfaces).mean().to_frame("mean")


def coverage() -> pd.DataFrame:
    """How often the interval of a difference contains the truth, and its mean width, in simulated runs.

    An error is the sum of the object's difficulty (deviation 1, the same for both models) and its difficulty for one
    model (0.2). With several seeds, the base of a seed adds a shift to both models (0.5), each training one of its own
    (0.2), and one for each object (0.2).
    """
    rows = []
    rng = np.random.default_rng(0)
    for shape in ("normal", "lognormal"):
        for each, seeds in ((2, 1), (4, 1), (10, 1), (40, 1), (10, 2), (10, 3), (40, 3)):
            classes = np.repeat(np.arange(4), each)
            estimates = [_simulated_run(rng, shape, classes, seeds, run) for run in range(RUNS)]
            inside = np.mean([estimate.low <= 0 <= estimate.high for estimate in estimates])
            width = np.mean([estimate.high - estimate.low for estimate in estimates])
            rows.append((shape, each, seeds, 100 * inside, width))
    return pd.DataFrame(rows, columns=["errors", "objects a class", "seeds", "inside, %", "width"])


def _simulated_run(rng, shape: str, classes: np.ndarray, seeds: int, run: int):
    count = len(classes)

    def own_error():
        return 0.2 * (rng.normal(size=count) if shape == "normal" else rng.lognormal(size=count) - np.exp(0.5))

    spread = 0.2 if seeds > 1 else 0.0
    difficulty = rng.normal(size=count) + rng.normal(0, 2.5 * spread, (seeds, 1))

    def model():
        return difficulty + own_error() + rng.normal(0, spread, (seeds, 1)) + rng.normal(0, spread, (seeds, count))

    return interval([model(), model()], classes, lambda m: m[..., 0] - m[..., 1], resamples=500, seed=run)


def evaluation_time(run: str, names: list[str]) -> pd.DataFrame:
    """Processor time of the first model of each experiment, on the run's validation and test objects."""
    rows = []
    for name in names:
        model = min(Path(run, "models", name).glob("seed-*/best.ckpt"))
        experiment = checkpoints.experiment_of(checkpoints.read(model, "reconstruction"))
        trained = load(model, model.with_name("training.json"), experiment, 0, "cpu")
        data = ExperimentData.load(run, experiment, ("validation", "test"))
        start = time.process_time()
        table = evaluate(trained, data)
        seconds = (time.process_time() - start) / len(table)
        rows.append((name, table["chamfer"].mean(), len(table), 1000 * seconds, seconds * SAMPLES_OF_THE_PAPER / 60))
    return pd.DataFrame(rows, columns=["experiment", "chamfer", "samples", "ms a sample", "minutes for 2,165"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run")
    parser.add_argument("--objects", type=int, default=3, help="a class")
    parser.add_argument("--experiment", nargs="+", default=[], help="trained in this run")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    items = select_objects(arguments.run, arguments.objects)
    error, surfaces = ring_error(items)
    tables = {
        f"The true mesh of {len(items)} objects as the prediction, m^2 x 9000": sampling_error(items).round(4),
        "The true mesh in rings, m^2": error.map("{:.2e}".format),
        "A touch's rings on a mesh and on a cloud": surfaces.round(3),
        "Intervals in simulated runs": coverage().round(2),
    }
    if arguments.experiment:
        tables["Evaluations, processor time"] = evaluation_time(arguments.run, arguments.experiment).round(2)
    for title, table in tables.items():
        print(f"\n{title}:\n{table.to_string()}")


if __name__ == "__main__":
    main()
