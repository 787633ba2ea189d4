"""Touch depth: error of depth maps, and of readings made from them, relative to exact rays, against time."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import igl
import numpy as np
import trimesh
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from scipy.interpolate import RegularGridInterpolator
from trimesh.ray.ray_pyembree import RayMeshIntersector

from palpate import mesh, store
from palpate.touch import RESOLUTION, SENSOR_RANGE, SENSOR_WIDTH, TRACERS, RayCaster, SphereTracer, shade
from palpate.touch.sensor import SENSOR_PLANE
from palpate.touch.sphere_tracing import TOLERANCE
from studies.error_vs_runtime.study import Method, Study, variants
from studies.exact_depth import exact_depth
from studies.subjects import Subject

TOUCHES = 4  # of an object: the first that its grasps have
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6)  # m
STEPS = (5, 10, 20, 50)  # at most; by default as many as a ray can take
MAX_GRID_STEPS = 200  # of sphere tracing on a grid; more than any ray takes
CELLS = (6, 12, 20)  # along each side of the box in front of a sensor


class Case(NamedTuple):
    """An object with sensors that touch it, all in its own frame, metres.

    visual: every face; decimated: meshes with fewer faces, by their file. position: (k, 3), rotation: (k, 3, 3) of the
    sensors. depth: (k, 100, 100) the reference; reading: (k, 100, 100, 3) uint8, made from it.
    """

    visual: trimesh.Trimesh
    decimated: dict[str, trimesh.Trimesh]
    position: np.ndarray
    rotation: np.ndarray
    depth: np.ndarray
    reading: np.ndarray


def traced_by_library(tracer: Callable, visual: trimesh.Trimesh, position, rotation, **options) -> np.ndarray:
    """Depth maps (k, 100, 100) of k sensors by one of the library's tracers, its search tree included."""
    return tracer(visual, **options).trace(position, rotation)


def _rays(position: np.ndarray, rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Starts (n, 3) and directions (n, 3) of all pixels of one sensor."""
    return SENSOR_PLANE.reshape(-1, 3) @ rotation.T + position, np.tile(rotation[:, 0], (RESOLUTION**2, 1))


def _in_range(depth: np.ndarray) -> np.ndarray:
    return np.where(depth <= SENSOR_RANGE, depth, np.inf).reshape(-1, RESOLUTION, RESOLUTION)


def traced_in_single_precision(visual: trimesh.Trimesh, position, rotation) -> np.ndarray:
    """Depth maps from Embree's own distances, in single precision."""
    scene = EmbreeScene(robust=True)
    TriangleMesh(scene, visual.vertices.astype(np.float32), visual.faces.astype(np.int32))
    depth = []
    for rays in map(_rays, position, rotation):
        hit = scene.run(*(part.astype(np.float32) for part in rays), output=1)
        depth.append(np.where(hit["primID"] >= 0, hit["tfar"], np.inf))
    return _in_range(np.array(depth))


def traced_by_trimesh(visual: trimesh.Trimesh, position, rotation) -> np.ndarray:
    """Depth maps by trimesh's wrapper of Embree, which intersects the face's plane in double precision."""
    caster = RayMeshIntersector(visual)
    depth = np.full((len(position), RESOLUTION**2), np.inf)
    for k, (start, direction) in enumerate(map(_rays, position, rotation)):
        place, ray, _ = caster.intersects_location(start, direction, multiple_hits=False)
        depth[k, ray] = (place - start[ray]) @ rotation[k, :, 0]
    return _in_range(depth)


def traced_on_grid(visual: trimesh.Trimesh, position, rotation, cells: int) -> np.ndarray:
    """Depth maps by sphere tracing on a grid of signed distances, interpolated linearly.

    Each sensor has its own grid over the box in front of it, with `cells` along each side.
    """
    half = SENSOR_WIDTH / 2
    axes = [np.linspace(0, SENSOR_RANGE, cells + 1)] + 2 * [np.linspace(-half, half, cells + 1)]
    corners = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    points = corners @ rotation.swapaxes(1, 2) + position[:, None]
    surface = np.asarray(visual.vertices, dtype=float), np.asarray(visual.faces, dtype=np.int64)
    kind = igl.SIGNED_DISTANCE_TYPE_FAST_WINDING_NUMBER
    signed = igl.signed_distance(points.reshape(-1, 3), *surface, sign_type=kind)[0].reshape(-1, *3 * (cells + 1,))
    return _in_range(np.array([_sphere_traced(RegularGridInterpolator(axes, distance)) for distance in signed]))


def _sphere_traced(distance: RegularGridInterpolator) -> np.ndarray:
    """Depth (10000,) of a sensor's pixels by sphere tracing on a signed distance, +inf for a miss.

    A step beyond the surface is undone by the next. A ray that starts inside the object finds where it leaves it.
    """
    points = SENSOR_PLANE.reshape(-1, 3).copy()
    side, moving = np.sign(distance(points)), np.arange(len(points))
    for _ in range(MAX_GRID_STEPS):
        step = side[moving] * distance(points[moving])
        moving, step = moving[np.abs(step) > TOLERANCE], step[np.abs(step) > TOLERANCE]
        points[moving, 0] = np.maximum(points[moving, 0] + step, 0)
        far = points[moving, 0] > SENSOR_RANGE
        points[moving[far], 0] = np.inf
        moving = moving[~far]
        if not len(moving):
            break
    points[moving, 0] = np.inf
    return points[:, 0]


class TouchStudy(Study):
    """Ways to compute the depth maps of an object's first touches; times include the search tree or grid.

    A run builds the search tree once for all touches of an object, several times as many as here.
    """

    stage = "touch"
    units = {"depth": "mm", "worst depth": "mm", "flipped": "% of pixels", "reading": "grey levels"}
    reference = "every ray against every face of the visual mesh (barycentric coordinates), double precision"

    @property
    def files(self) -> list[str]:
        """The run's meshes with fewer faces."""
        return ["collision.ply", *(f"level-{faces}.ply" for faces in self.settings["mesh"]["levels"])]

    def case(self, subject: Subject) -> Case:
        visual = mesh.load_visual(subject.folder)
        position, rotation = _touching_sensors(self.run, subject)
        depths = [exact_depth(visual.triangles, *pose) for pose in zip(position, rotation, strict=True)]
        depth = np.array(depths).reshape(-1, RESOLUTION, RESOLUTION)
        decimated = {file: trimesh.load_mesh(subject.folder / file, process=False) for file in self.files}
        return Case(visual, decimated, position, rotation, depth, shade(depth))

    def methods(self) -> list[Method]:
        def of(make: Callable[..., np.ndarray], *args, **options) -> Callable[[Case], np.ndarray]:
            return lambda case: make(*args, case.visual, case.position, case.rotation, **options)

        def decimated(file: str) -> Callable[[Case], np.ndarray]:
            return lambda case: traced_by_library(TRACERS[own], case.decimated[file], case.position, case.rotation)

        own, spheres = self.settings["touch"]["method"], partial(of, traced_by_library, SphereTracer)
        tolerance = TOLERANCE if own == "sphere_tracing" else None
        return [
            Method("embree", "precision", "double", of(traced_by_library, RayCaster), own == "embree"),
            Method("embree alone", "precision", "single", of(traced_in_single_precision)),
            Method("trimesh's wrapper", "precision", "double", of(traced_by_trimesh)),
            *variants("sphere tracing", "tolerance, m", TOLERANCES, lambda t: spheres(tolerance=t), tolerance),
            *variants("sphere tracing", "steps", STEPS, lambda steps: spheres(max_steps=steps)),
            *variants("sphere tracing on a grid", "cells a side", CELLS, lambda n: of(traced_on_grid, cells=n)),
            *variants(f"{own}, fewer faces", "mesh", self.files, decimated),
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
