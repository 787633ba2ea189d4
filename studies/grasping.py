"""Graspers of a run's objects, and closings of the hand."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from palpate import store
from palpate.grasp.grasp import Grasper
from palpate.hand import Hand
from palpate.mesh import OBJECT_POSITION, load_collision, load_visual
from studies.subjects import Subject


class Closing(NamedTuple):
    """A palm pose (4, 4) in the object's frame, clear of the object, and the servos' targets (J,)."""

    pose: np.ndarray
    targets: np.ndarray


def grasper_of(run: Path | str, subject: Subject, **options: Any) -> Grasper:
    """The grasper of an object of a run with the run's hand; reads its meshes, surface and grasps."""
    surface = store.read(Path(run) / f"surface/{subject.batch}.zarr", "object", "points")
    points = surface["points"][surface["object"].tolist().index(subject.name)].astype(float) - OBJECT_POSITION
    hand = Hand.from_arrays(store.open(Path(run) / f"grasps/{subject.batch}.h5"), prefix="hand/")
    return Grasper(load_visual(subject.folder), load_collision(subject.folder), points, hand, **options)


def find_closings(grasper: Grasper, rng: np.random.Generator, count: int) -> list[Closing]:
    """At most `count` closings: fewer where no free palm pose is found."""
    poses = (grasper.free_palm_pose(rng) for _ in range(count))
    return [Closing(pose, grasper.workspace.targets(pose, grasper.surface)) for pose in poses if pose is not None]
