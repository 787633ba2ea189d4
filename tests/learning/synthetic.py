"""Evaluations made up in the form that the rules write, with averages that are known."""

from pathlib import Path

import numpy as np
import pandas as pd

from palpate.experiments import Experiment, Experiments
from palpate.learning.rows import COLUMNS, RING_COLUMNS, SELECTION_COLUMNS, TOUCH_COLUMNS
from palpate.results.published import paper_values

ROOT = Path(__file__).parents[2]
CLASSES = ("bottle", "knife", "cellphone", "rifle")
DECLARED = Experiments.read(ROOT / "config/experiments.yaml", ROOT / "workflow/schemas/experiments.schema.yaml")
EXPERIMENTS = DECLARED.experiments


def of_table(table: str) -> dict[str, Experiment]:
    """The experiments of a table by their names."""
    return DECLARED.tables[table].by_name


def objects(each: int, classes=CLASSES) -> list[tuple[str, str]]:
    return [(f"{name}-{index:04d}", name) for name in classes for index in range(each)]


def evaluations(means: dict[str, float], each=6, seeds=(0,), spread=0.02, windows=2, seed_spread=0.0, rng=0):
    """Rows of evaluation files: `means[experiment]` is its error but for noise. All experiments share what
    makes an object hard."""
    rng = np.random.default_rng(rng)
    rows = []
    for split in ("validation", "test"):
        names = [(f"{split}-{name}", kind) for name, kind in objects(each)]
        hard = rng.normal(0, 0.1, len(names))
        for experiment, mean in means.items():
            for seed in seeds:
                shift = rng.normal(0, seed_spread)
                for (name, kind), harder in zip(names, hard, strict=True):
                    for window in range(windows):
                        error = mean + harder + shift + rng.normal(0, spread)
                        quality = 20 + error, 1.0, 2.0, 30.0
                        rows.append(
                            (experiment, seed, name, kind, split, window, error, 50.0, 70.0, *quality, 0.1, 700)
                        )
    return pd.DataFrame(rows, columns=COLUMNS)


def rings(means: dict[tuple[str, int], float], each=6, spread=1e-6, rng=0):
    rng = np.random.default_rng(rng)
    rows = []
    names = [(f"test-{name}", kind) for name, kind in objects(each)]
    hard = rng.normal(1, 0.1, len(names))
    for (experiment, ring), mean in means.items():
        for (name, kind), harder in zip(names, hard, strict=True):
            for grasp in range(2):
                distance = mean * harder + rng.normal(0, spread)
                rows.append((experiment, 0, name, kind, "test", 0, grasp, 1, ring, 100 * ring, distance, 700))
    return pd.DataFrame(rows, columns=RING_COLUMNS)


def touches(cloud=0.01, chart=0.02, each=6, spread=0.001, rng=0):
    rng = np.random.default_rng(rng)
    rows = [
        (
            f"test-{name}", kind, "test", grasp, sensor,
            cloud + rng.normal(0, spread), chart + rng.normal(0, spread), 400,
        )
        for name, kind in objects(each)
        for grasp in range(2)
        for sensor in range(3)
    ]  # fmt: skip
    return pd.DataFrame(rows, columns=TOUCH_COLUMNS)


def selections(means: dict[tuple[str, str], list[float]], first=0, each=4, spread=1e-3, rng=0):
    """Rows of chosen grasps: `means[experiment, strategy]` are its errors after `first`, first + 1, ... grasps."""
    rng = np.random.default_rng(rng)
    rows = []
    for (experiment, strategy), errors in means.items():
        for name, kind in objects(each):
            for count, mean in enumerate(errors, start=first):
                error = mean + rng.normal(0, spread)
                rows.append((experiment, 0, f"test-{name}", kind, "test", strategy, count, 20, error, 700))
    return pd.DataFrame(rows, columns=SELECTION_COLUMNS)


def published_means() -> dict[str, float]:
    """The paper's averages: of the validation split where it has them."""
    means = dict(paper_values("grasps")[["experiment", "value"]].itertuples(index=False))
    for table in ("input_modalities", "model_selection"):
        frame = paper_values(table)
        frame = frame[frame["class"] == "average"]
        means |= dict(frame[["experiment", "value"]].itertuples(index=False))
    return means


def means_of_tables() -> dict[str, float]:
    """Those of the paper, and for other experiments of a table those of the paper's same inputs."""
    means = published_means()
    of_tables = [each for table in DECLARED.tables.values() for each in table.by_name.values()]
    return means | {each.name: means.get(each.stated_as, 1.0) for each in of_tables}


def published_rings() -> dict[tuple[str, int], float]:
    """Those of the paper; for other experiments of its table those of the same inputs, or of vision alone."""
    paper = {(row.experiment, row.ring): row.value for row in paper_values("extrapolation").itertuples()}
    rings = {(name, ring) for name in of_table("extrapolation") for _, ring in paper}
    same = {key: (EXPERIMENTS[key[0]].stated_as, key[1]) for key in rings}
    alone = {key: (key[0].replace("no_comm", "charts").removesuffix("_touch"), key[1]) for key in rings}
    return paper | {key: paper.get(same[key]) or paper.get(alone[key], 5e-5) for key in sorted(rings)}
