"""Retrieval measured as models are, on a run of balls: the training ball of the nearest size is retrieved."""

import numpy as np
import pytest
import torch

from palpate import store
from palpate.camera import paper_camera
from palpate.experiments import Experiment
from palpate.learning.data import ExperimentData
from palpate.learning.evaluate import Trained, evaluate, retrieval
from palpate.learning.rows import COLUMNS, QUALITY
from palpate.models.retrieval import Objects, Retrieval

# The last is nearest to the fourth, which is of the test split too.
BALLS = {"a": ("train", 0.05), "b": ("train", 0.08), "c": ("validation", 0.06), "d": ("test", 0.09), "e": ("test", 0.1)}
RETRIEVED = {"c": "a", "d": "b", "e": "b"}
GRASPS, SIZE = 2, 64
COUNT = len(BALLS)


def surface() -> np.ndarray:
    """(o, n, 3) float32: the same directions from the centre, so that distances between balls are known."""
    directions = np.random.default_rng(0).normal(size=(500, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return np.stack([radius * directions for _, radius in BALLS.values()]).astype(np.float32)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The balls' silhouettes; the hand is the left half of the image."""
    folder = tmp_path_factory.mktemp("retrieval")
    rows = [f"{name},ball,{split},batch-0000\n" for name, (split, _) in BALLS.items()]
    (folder / "catalogue.csv").write_text("object,class,split,batch\n" + "".join(rows))
    (folder / "rejected.csv").write_text("object,stage,reason\n")
    rows, columns = np.indices((SIZE, SIZE)) - (SIZE - 1) / 2
    radii = np.array([radius for _, radius in BALLS.values()])[:, None, None, None]
    mask = np.hypot(rows, columns) < 280 * radii  # (o, 1, p, p)
    hand = np.broadcast_to(columns < 0, mask.shape)
    of_grasps = {
        "occluded_mask": 255 * (mask & ~hand).astype(np.uint8),
        "occluded_depth": np.where(mask | hand, 0.7, np.inf).astype(np.float16),
        "occluded": np.zeros((*mask.shape, 3), np.uint8),
    }
    camera = paper_camera(SIZE)
    names = {"object": np.array(list(BALLS))}
    vision = names | {
        "unoccluded": np.zeros((*mask.shape, 3), np.uint8),
        "unoccluded_mask": 255 * mask.astype(np.uint8),
        "unoccluded_depth": np.where(mask, 0.7, np.inf).astype(np.float16),
        "intrinsics": np.tile(camera.intrinsics(), (COUNT, 1, 1, 1)),
        "extrinsics": np.tile(camera.extrinsics(), (COUNT, 1, 1, 1)),
        **{name: np.repeat(values[:, None], GRASPS, axis=1) for name, values in of_grasps.items()},
    }
    store.write(folder / "vision" / "batch-0000.zarr", "vision", vision, {"seed": 0, "made_from": {}})
    points = names | {"points": surface()}
    store.write(folder / "surface" / "batch-0000.zarr", "surface", points, {"seed": 0, "made_from": {}})
    return folder


def check(table):
    assert list(table.columns) == list(COLUMNS)
    assert set(table["object"]) == set(RETRIEVED) and (table["steps"] == 0).all()
    assert table[list(QUALITY)].isna().all(axis=None) and (table["seconds"] > 0).all()
    for row in table.to_dict("records"):
        (_, radius), (_, other) = BALLS[row["object"]], BALLS[RETRIEVED[row["object"]]]
        assert row["chamfer"] == pytest.approx(9000 * 2 * (radius - other) ** 2, rel=0.01)


@pytest.mark.parametrize("vision, windows", [("unoccluded", 1), ("occluded", GRASPS)])
def test_by_silhouettes_of_a_run(run, vision, windows):
    experiment = Experiment("retrieval", "retrieval", vision, False, 1)
    splits = ["validation", "test"]
    table = evaluate(retrieval(run, experiment, 0), ExperimentData.load(run, experiment, splits), splits=splits)
    assert len(table) == windows * len(RETRIEVED)
    check(table)


def test_by_touches():
    points = surface()
    charts = np.repeat(points[:, None, None, :81], GRASPS, axis=1)
    arrays = {
        "object": list(BALLS),
        "class": ["ball"] * COUNT,
        "split": [split for split, _ in BALLS.values()],
        "points": points,
        "success": np.ones((COUNT, GRASPS, 1), bool),
        "position": charts[:, :, :, 0],
        "charts": charts,
    }
    experiment = Experiment("retrieval", "retrieval", "none", True, 1)
    model = Retrieval(Objects(torch.from_numpy(points[:2])))
    table = evaluate(Trained(model, experiment, 0, 0), ExperimentData(arrays))
    assert len(table) == GRASPS * len(RETRIEVED)
    check(table)
