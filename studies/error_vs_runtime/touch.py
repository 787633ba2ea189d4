"""Touch depth: error of depth maps, and of readings made from them, relative to exact rays, against time."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from palpate import mesh, store
from palpate.touch import RESOLUTION, SENSOR_RANGE, RayCaster, SphereTracer, shade
from palpate.touch.sensor import SENSOR_PLANE
from palpate.touch.sphere_tracing import TOLERANCE
from studies.error_vs_runtime.study import Method, Study, variants
from studies.exact_depth import exact_depth
from studies.subjects import Subject

TOUCHES = 4  # of an object: the first that its grasps have
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6)  # m
STEPS = (5, 10, 20, 50)  # at most; by default as many as a ray can take


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


def traced_by_library(tracer: Callable, case: Case, **options) -> np.ndarray:
    """Depth maps (k, 100, 100) of k sensors by one of the library's tracers, its search tree included."""
    return tracer(case.visual, **options).trace(case.position, case.rotation)


def traced_in_single_precision(case: Case) -> np.ndarray:
    """Depth maps (k, 100, 100) from Embree's own distances, in single precision."""
    scene, plane, depth = EmbreeScene(robust=True), SENSOR_PLANE.reshape(-1, 3), []
    TriangleMesh(scene, case.visual.vertices.astype(np.float32), case.visual.faces.astype(np.int32))
    for position, rotation in zip(case.position, case.rotation, strict=True):
        rays = plane @ rotation.T + position, np.tile(rotation[:, 0], (len(plane), 1))
        hit = scene.run(*(part.astype(np.float32) for part in rays), output=1)
        depth.append(np.where((hit["primID"] >= 0) & (hit["tfar"] <= SENSOR_RANGE), hit["tfar"], np.inf))
    return np.array(depth).reshape(-1, RESOLUTION, RESOLUTION)


class TouchStudy(Study):
    """Ways to compute the depth maps of an object's first touches; times include the search tree.

    A run builds the search tree once for all touches of an object, several times as many as here.
    """

    stage = "touch"
    units = {"depth": "mm", "worst depth": "mm", "flipped": "% of pixels", "reading": "grey levels"}
    reference = "every ray against every face of the visual mesh (barycentric coordinates), double precision"

    def case(self, subject: Subject) -> Case:
        visual = mesh.load_visual(subject.folder)
        position, rotation = _touching_sensors(self.run, subject)
        depths = [exact_depth(visual.triangles, *pose) for pose in zip(position, rotation, strict=True)]
        depth = np.array(depths).reshape(-1, RESOLUTION, RESOLUTION)
        return Case(visual, position, rotation, depth, shade(depth))

    def methods(self) -> list[Method]:
        own, spheres = self.settings["touch"]["method"], partial(partial, traced_by_library, SphereTracer)
        tolerance = TOLERANCE if own == "sphere_tracing" else None
        return [
            Method("embree", "precision", "double", partial(traced_by_library, RayCaster), own == "embree"),
            Method("embree alone", "precision", "single", traced_in_single_precision),
            *variants("sphere tracing", "tolerance, m", TOLERANCES, lambda t: spheres(tolerance=t), tolerance),
            *variants("sphere tracing", "steps", STEPS, lambda steps: spheres(max_steps=steps)),
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
