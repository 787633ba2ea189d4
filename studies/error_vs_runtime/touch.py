"""Touch depth: error of depth maps, and of readings made from them, relative to exact rays, against time."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh

from palpate import mesh, store
from palpate.touch import RESOLUTION, RayCaster, shade
from studies.error_vs_runtime.study import Method, Study, variants
from studies.exact_depth import exact_depth
from studies.sphere_tracing import SphereTracer
from studies.subjects import Subject

TOUCHES = 4  # of an object: the first that its grasps have
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6)  # m


class Case(NamedTuple):
    """An object with sensors that touch it, all in its own frame, metres.

    visual: every face. position: (k, 3), rotation: (k, 3, 3) of the sensors. depth: (k, 100, 100) the reference;
    reading: (k, 100, 100, 3) uint8, made from it.
    """

    visual: trimesh.Trimesh
    position: np.ndarray
    rotation: np.ndarray
    depth: np.ndarray
    reading: np.ndarray


def traced(tracer: Callable, case: Case, **options) -> np.ndarray:
    """Depth maps (k, 100, 100) of k sensors by a tracer, its search tree included."""
    return tracer(case.visual, **options).trace(case.position, case.rotation)


class TouchStudy(Study):
    """Ways to compute the depth maps of an object's first touches; times include the search tree.

    A run builds the search tree once for all touches of an object, several times as many as here.
    """

    stage = "touch"
    units = {"depth": "mm", "worst depth": "mm", "flipped": "% of pixels", "reading": "grey levels"}
    reference = "every ray against every face of the visual mesh (barycentric coordinates), double precision"

    def case(self, subject: Subject) -> Case:
        """The object's first touches, with exact depths."""
        visual = mesh.load_visual(subject.folder)
        position, rotation = _touching_sensors(self.run, subject)
        depths = [exact_depth(visual.triangles, *pose) for pose in zip(position, rotation, strict=True)]
        depth = np.array(depths).reshape(-1, RESOLUTION, RESOLUTION)
        return Case(visual, position, rotation, depth, shade(depth))

    def methods(self) -> list[Method]:
        """The engine, and sphere tracing with several tolerances."""
        return [
            Method("embree", "precision", "double", partial(traced, RayCaster), True),
            *variants(
                "sphere tracing", "tolerance, m", TOLERANCES, lambda t: partial(traced, SphereTracer, tolerance=t)
            ),
        ]

    def errors(self, case: Case, result: np.ndarray) -> dict[str, float]:
        """Errors of depth over pixels in range in both; of readings, over pixels in range in either."""
        hit, reference_hit = np.isfinite(result), np.isfinite(case.depth)
        off = 1e3 * np.abs(result[hit & reference_hit] - case.depth[hit & reference_hit])
        grey = np.abs(shade(result).astype(int) - case.reading)[hit | reference_hit]
        return {
            "depth": float(off.mean()) if len(off) else np.nan,
            "worst depth": float(off.max()) if len(off) else np.nan,
            "flipped": 100 * float((hit != reference_hit).mean()),
            "reading": float(grey.mean()) if len(grey) else 0.0,
        }


def _touching_sensors(run: Path, subject: Subject) -> tuple[np.ndarray, np.ndarray]:
    """Positions (k, 3) and rotations (k, 3, 3) of the first sensors that touch, in the object's frame."""
    names = ("object", "sensor_position", "sensor_rotation", "touches")
    objects, position, rotation, touches = store.read(run / f"grasps/{subject.batch}.h5", *names).values()
    row = objects.tolist().index(subject.name)
    position, rotation = position[row][touches[row]], rotation[row][touches[row]]
    return position[:TOUCHES] - mesh.OBJECT_POSITION, rotation[:TOUCHES]


study = TouchStudy
