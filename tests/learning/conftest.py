"""Small things to train on: ellipsoids, their pictures and their touches, in memory."""

import multiprocessing
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from palpate.architectures import ATLAS_RADIUS, GCN, Architecture, Encoder
from palpate.camera import looking_at, paper_camera
from palpate.charts import sphere
from palpate.experiments import Experiment
from palpate.learning.data import ExperimentData
from palpate.learning.recipes import ReconstructionSettings
from palpate.mesh import OBJECT_POSITION

SPLITS = ["train"] * 4 + ["validation"] * 2 + ["test"]
ARCHITECTURE = Architecture(
    Encoder([4, 6], [1, 1], [1, 2], padding=1), GCN(3, 9), normalise_positions=True, init="he", last_layer_scale=0.01
)
SETTINGS = ReconstructionSettings(
    rate=3e-3,
    schedule="one_cycle",
    clip=1.0,
    batch=2,
    steps=8,
    epochs=None,
    evaluate_every=2,
    patience=None,
    loss_points=200,
    validation_samples=None,
    validation_points=200,
    epoch="objects",
    architecture=ARCHITECTURE,
)
OCCLUDED_TOUCH = Experiment("occluded_touch", "charts", "occluded", True, 1)
TOUCH_ONLY = Experiment("touch_only", "charts", "none", True, 2)


def kill_when(path: Path, train: Callable, *arguments, **settings) -> None:
    """Train in a process of its own, and kill it as soon as a file exists: with SIGKILL, which nothing can handle.

    The process is forked from one that has loaded torch, once for all tests, and has done nothing else.
    """
    processes = multiprocessing.get_context("forkserver")
    processes.set_forkserver_preload(["palpate.learning.loop", __name__])
    process = processes.Process(target=train, args=arguments, kwargs=settings)
    process.start()
    until = time.monotonic() + 300
    while not path.exists() and process.is_alive() and time.monotonic() < until:
        time.sleep(0.005)
    process.kill()
    process.join()
    assert path.exists(), "it has ended before it was killed" if process.exitcode == 0 else process.exitcode


def made_up(
    vision: str = "occluded", touch: str = "charts", grasps: int = 3, seed: int = 0, cameras: int = 1
) -> ExperimentData:
    """Seven ellipsoids, with random pixels."""
    random = np.random.default_rng(seed)
    o = len(SPLITS)
    directions = random.standard_normal((o, 500, 3))
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    axes = random.uniform(0.05, 0.2, (o, 1, 3))
    points = directions * axes + OBJECT_POSITION
    charts = axes / ATLAS_RADIUS * (sphere()[0].numpy() - OBJECT_POSITION) + OBJECT_POSITION
    arrays = {
        "object": np.array([f"egg-{number}" for number in range(o)]),
        "class": np.array(["egg"] * o),
        "split": np.array(SPLITS),
        "points": points.astype(np.float32),
        "template": charts.astype(np.float32),
    }
    if vision == "occluded":
        arrays["occluded"] = random.integers(0, 256, (o, grasps, cameras, 24, 24, 3), dtype=np.uint8)
    if vision == "unoccluded":
        arrays["unoccluded"] = random.integers(0, 256, (o, cameras, 24, 24, 3), dtype=np.uint8)
    if vision in ("occluded", "unoccluded"):
        around = [paper_camera(24), *(looking_at(OBJECT_POSITION, (1, k, 1), 24) for k in range(1, cameras))]
        arrays["image_camera"] = np.tile(np.stack([each.matrix() for each in around]).astype(np.float32), (o, 1, 1, 1))
    if vision == "views":
        arrays["views"] = random.integers(0, 256, (o, 5, 24, 24, 3), dtype=np.uint8)
        arrays["camera"] = random.standard_normal((o, 5, 3, 4)).astype(np.float32)
    if touch != "none":
        arrays["success"] = random.random((o, grasps, 4)) < 0.7
        arrays["position"] = (random.uniform(-0.1, 0.1, (o, grasps, 4, 3)) + OBJECT_POSITION).astype(np.float32)
        arrays["rotation"] = np.broadcast_to(np.eye(3, dtype=np.float32), (o, grasps, 4, 3, 3)).copy()
    if touch == "charts":
        spread = random.uniform(-0.005, 0.005, (o, grasps, 4, 81, 3))
        arrays["charts"] = (arrays["position"][:, :, :, None] + spread).astype(np.float32)
    if touch == "readings":
        arrays["reading"] = random.integers(0, 256, (o, grasps, 4, 100, 100, 3), dtype=np.uint8)
        arrays["reading"][~arrays["success"]] = 90
    for name, axes in ("unoccluded", ()), ("occluded", (grasps,)), ("hand", (grasps,)):
        arrays[f"{name}_silhouette"] = random.random((o, *axes, cameras, 24, 24)) < 0.5
    return ExperimentData(arrays)


@pytest.fixture
def data() -> ExperimentData:
    return made_up()
