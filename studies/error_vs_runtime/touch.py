"""Touch depth: error of depth maps, and of readings made from them, relative to exact rays, against time."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

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
from studies.error_vs_runtime.study import Method, Study
from studies.subjects import Subject

TOUCHES = 4  # of an object: the first that its grasps have
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6)  # m
STEPS = (5, 10, 20, 50)  # at most; by default as many as a ray can take
MAX_GRID_STEPS = 200  # of sphere tracing on a grid; more than any ray takes
CELLS = (6, 12, 20)  # along each side of the box in front of a sensor


class Case(NamedTuple):
    """An object with sensors that touch it, all in its own frame, metres.

    Attributes:
        visual: every face; decimated: meshes with fewer faces, by their file.
        position: (k, 3), rotation: (k, 3, 3) of the sensors.
        depth: (k, 100, 100) the reference; reading: (k, 100, 100, 3) uint8, made from it.
    """

    visual: trimesh.Trimesh
    decimated: dict[str, trimesh.Trimesh]
    position: np.ndarray
    rotation: np.ndarray
    depth: np.ndarray
    reading: np.ndarray


def exact_depth(triangles: np.ndarray, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Depth of every pixel of one sensor (100, 100), +inf beyond its range: tests every ray with every face.

    By Moeller and Trumbore (1997), in the sensor's frame, in the precision of the arguments. Faces whose bounding
    boxes miss all rays are skipped.

    triangles: (f, 3, 3), position: (3,), rotation: (3, 3), all in one frame, metres.
    """
    corners = (triangles - position) @ rotation
    low, high = corners.min(axis=1), corners.max(axis=1)
    half = SENSOR_WIDTH / 2
    ahead = (low[:, 0] <= SENSOR_RANGE) & (high[:, 0] >= 0)
    ahead &= (low[:, 1:] <= half).all(axis=1) & (high[:, 1:] >= -half).all(axis=1)
    a, b, c = corners[ahead].swapaxes(0, 1)
    across = np.cross(np.array([1, 0, 0], dtype=corners.dtype), c - a)
    determinant = ((b - a) * across).sum(axis=-1)
    depth = np.full((RESOLUTION, RESOLUTION), np.inf, dtype=corners.dtype)
    with np.errstate(divide="ignore", invalid="ignore"):  # a face seen exactly edge-on is not hit
        for row, starts in enumerate(SENSOR_PLANE):
            away = starts[:, None] - a
            turned = np.cross(away, b - a)
            u = (away * across).sum(axis=-1) / determinant
            v = turned[..., 0] / determinant
            t = (turned * (c - a)).sum(axis=-1) / determinant
            inside = (u >= 0) & (v >= 0) & (u + v <= 1) & (t >= 0) & (t <= SENSOR_RANGE)
            depth[row] = np.where(inside, t, np.inf).min(axis=1, initial=np.inf)
    return depth


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
        start, direction = (part.astype(np.float32) for part in rays)
        hit = scene.run(start, direction, output=1)
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
    signed = igl.signed_distance(
        points.reshape(-1, 3),
        np.asarray(visual.vertices, dtype=float),
        np.asarray(visual.faces, dtype=np.int64),
        sign_type=igl.SIGNED_DISTANCE_TYPE_FAST_WINDING_NUMBER,
    )[0].reshape(-1, *3 * (cells + 1,))
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

    Args:
        run: its folder; meshes and grasps are read.
        subjects: objects.
        settings: of the config; `touch` and `mesh` are read.
    """

    stage = "touch"
    units = {"depth": "mm", "worst depth": "mm", "flipped": "% of pixels", "reading": "grey levels"}
    reference = "every ray against every face of the visual mesh (Moeller and Trumbore), double precision"

    def __init__(self, run: Path, subjects: Sequence[Subject], settings: Mapping[str, Any]):
        self.run, self.subjects = Path(run), subjects
        self.tracer = settings["touch"]["method"]
        self.files = ["collision.ply", *(f"level-{faces}.ply" for faces in settings["mesh"]["levels"])]

    def cases(self) -> Iterable[tuple[str, Case]]:
        for subject in self.subjects:
            yield subject.name, self._case(subject)

    def _case(self, subject: Subject) -> Case:
        visual = mesh.load_visual(subject.folder)
        position, rotation = _touching_sensors(self.run, subject)
        triangles = np.asarray(visual.triangles, dtype=float)
        depth = np.array([exact_depth(triangles, p, r) for p, r in zip(position, rotation, strict=True)])
        decimated = {file: trimesh.load_mesh(subject.folder / file, process=False) for file in self.files}
        return Case(visual, decimated, position, rotation, depth, shade(depth))

    def methods(self) -> list[Method]:
        def of(make: Callable[..., np.ndarray], *args, **options) -> Callable[[Case], np.ndarray]:
            make = partial(make, *args)
            return lambda case: make(case.visual, case.position, case.rotation, **options)

        def decimated(file: str) -> Callable[[Case], np.ndarray]:
            tracer = TRACERS[self.tracer]
            return lambda case: traced_by_library(tracer, case.decimated[file], case.position, case.rotation)

        spheres = self.tracer == "sphere_tracing"
        methods = [
            Method("embree", "precision", "double", of(traced_by_library, RayCaster), self.tracer == "embree"),
            Method("embree alone", "precision", "single", of(traced_in_single_precision)),
            Method("trimesh's wrapper", "precision", "double", of(traced_by_trimesh)),
        ]
        for tolerance in TOLERANCES:
            run = of(traced_by_library, SphereTracer, tolerance=tolerance)
            chosen = spheres and tolerance == TOLERANCE
            methods.append(Method("sphere tracing", "tolerance, m", tolerance, run, chosen))
        for steps in STEPS:
            run = of(traced_by_library, SphereTracer, max_steps=steps)
            methods.append(Method("sphere tracing", "steps", steps, run))
        for cells in CELLS:
            methods.append(Method("sphere tracing on a grid", "cells a side", cells, of(traced_on_grid, cells=cells)))
        for file in self.files:
            methods.append(Method(f"{self.tracer}, fewer faces", "mesh", file, decimated(file)))
        return methods

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


def study(run: Path, subjects: Sequence[Subject], settings: Mapping[str, Any]) -> TouchStudy:
    """The study of a run; `settings`: `touch` and `mesh` of the config."""
    return TouchStudy(run, subjects, settings)
