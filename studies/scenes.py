"""Scenes of a run's objects, and differences of their images."""

from pathlib import Path
from typing import Any

import numpy as np

from palpate import store
from palpate.hand import Hand
from palpate.scene import GRASP_ARRAYS, Scene
from studies.subjects import Subject


def scene_of(run: Path | str, subject: Subject, **others: Any) -> Scene:
    """The scene of an object and its grasps in a run; others: further attributes of the scene."""
    grasps = store.read(Path(run) / "grasps" / f"{subject.batch}.h5")
    row = grasps["object"].tolist().index(subject.name)
    hand = Hand.from_arrays(grasps, prefix="hand/")
    return Scene.from_grasps(subject.folder, {name: grasps[name][row] for name in GRASP_ARRAYS}, hand, **others)


def rms(image: np.ndarray, other: np.ndarray) -> float:
    """Root mean square difference of grey levels or colours, arrays of one shape."""
    return float(np.sqrt(np.mean((np.asarray(image, dtype=float) - other) ** 2)))
