"""Rings of surface points around each touch (section 5.3), with the numbers of the published `calc_local_chamfer`.
A grid of 100 x 100 points, five times the sensor's size and centred on it, is projected along the sensor's x onto the
true surface. Ring r lies between the planes of r - 1 and r times the sensor's size; others are omitted."""

import logging
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from palpate import store
from palpate.protocol import RINGS
from palpate.sensor import DIGIT, Sensor, Size

if TYPE_CHECKING:
    from palpate.mesh import Mesh

log = logging.getLogger(__name__)

GRID = 100  # points along a side of the grid
SAMPLES = 30_000  # on a prediction: with 10,000, 0.2 m^2 of surface is 6e-6 m^2 from its nearest sample
# Neighbours of a point of a cloud (a mesh's stand-in) that its disc must reach for discs to leave no gaps:
# with uniform points a ray passes between discs of this size once in 150 times (Poisson, e^-5).
DISC_NEIGHBOURS = 5

_SIDE = ((np.arange(GRID) + 0.5) / GRID - 0.5) * RINGS[-1]  # sensor widths, and heights
# (100, 100) the ring that each point of the grid belongs to.
RING = np.ceil(2 * np.maximum(*np.abs(np.meshgrid(_SIDE, _SIDE)))).astype(int)


@cache
def plane(size: Size) -> np.ndarray:
    """(10000, 3) the grid on the plane of a sensor of a size, sensor frame, row-major."""
    z, y = np.meshgrid(*(_SIDE * edge for edge in size), indexing="ij")
    return np.stack([np.zeros(GRID**2), y.ravel(), z.ravel()], axis=1)


def reach(sensor: Sensor) -> float:
    """Metres from the sensor plane beyond which surface is another part of the object, not the touch's surroundings:
    the sensor's range, and as much as the outermost ring is from the centre."""
    return sensor.range + RINGS[-1] * max(sensor.size) / 2


class MeshSurface:
    """A mesh that rings are projected onto, by ray casting."""

    def __init__(self, mesh: "Mesh", object_position: Sequence[float] = (0.0, 0.0, 0.0), sensor: Sensor = DIGIT):
        """mesh: in its own frame, metres; object_position: (3,) of that frame's origin in the world; sensor: that the
        rings are around. Raises ValueError if no face has an area."""
        from palpate.surface.embree import RayMesh  # here: an evaluation needs neither embree nor trimesh

        self._mesh, self._plane, self._reach = RayMesh(mesh), plane(sensor.size), reach(sensor)
        self._object_position = np.asarray(object_position, dtype=float)

    def project(self, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """(100, 100) float32 distance from the grid of a sensor at `position` (3,), `rotation` (3, 3), world, to the
        first face of either side along its x; +inf where there is none within `reach`."""
        origin = np.asarray(position) - self._object_position
        start = self._plane @ np.asarray(rotation).T + origin
        direction = np.asarray(rotation)[:, 0]
        face = self._mesh.first_face(start, direction[None], self._reach)
        hit = face >= 0
        corners, normal = self._mesh.triangles[face[hit]], self._mesh.normals[face[hit]]
        with np.errstate(divide="ignore", invalid="ignore"):  # faces seen edge-on
            along = np.einsum("ni,ni->n", corners[:, 0] - start[hit], normal) / (normal @ direction)
        # For a face seen edge-on its plane is inaccurate, but the ray meets the face itself in any case.
        ahead = (corners - origin) @ direction
        along = np.clip(np.nan_to_num(along, nan=0), ahead.min(axis=1), ahead.max(axis=1))
        depth = np.full(len(face), np.inf)
        depth[hit] = np.where((along >= 0) & (along <= self._reach), along, np.inf)
        return depth.reshape(GRID, GRID).astype(np.float32)


class CloudSurface:
    """As `MeshSurface`, of points (n, 3) on a surface, world frame, m, for runs without meshes: each is a small disc,
    as wide as the cloud is apart, that faces the sensor. Raises ValueError for fewer than 6."""

    def __init__(self, points: np.ndarray, sensor: Sensor = DIGIT):
        self._sensor = sensor
        self._points = np.asarray(points, dtype=float)
        if len(self._points) <= DISC_NEIGHBOURS:
            raise ValueError(f"a cloud of {len(self._points)} points is no surface to project rings onto")
        apart = cKDTree(self._points).query(self._points, k=[DISC_NEIGHBOURS + 1])[0]
        self.radius = float(np.median(apart))

    def project(self, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """As `MeshSurface.project`, to the first disc."""
        local = (self._points - position) @ np.asarray(rotation)
        half = RINGS[-1] * np.array([self._sensor.width, self._sensor.height]) / 2 + self.radius
        near = (local[:, 0] >= 0) & (local[:, 0] <= reach(self._sensor)) & (np.abs(local[:, 1:]) <= half).all(axis=1)
        depth = np.full(GRID**2, np.inf)
        if near.any():
            local = local[near]
            rays, points = cKDTree(plane(self._sensor.size)[:, 1:]), cKDTree(local[:, 1:])
            pairs = points.sparse_distance_matrix(rays, self.radius, output_type="coo_matrix")
            first, ahead = depth.copy(), local[pairs.row, 0]
            np.minimum.at(first, pairs.col, ahead)
            # Of the discs of the first layer, the one whose centre is nearest to the ray.
            layer = np.flatnonzero(ahead <= first[pairs.col] + 2 * self.radius)
            layer = layer[np.argsort(-pairs.data[layer], kind="stable")]
            depth[pairs.col[layer]] = ahead[layer]
        return depth.reshape(GRID, GRID).astype(np.float32)


def ring_points(
    depth: np.ndarray, position: np.ndarray, rotation: np.ndarray, sensor: Sensor = DIGIT
) -> list[np.ndarray]:
    """The surface points of each ring, from what `project` gave: five arrays (n, 3), world frame, metres."""
    points = plane(sensor.size).copy()
    points[:, 0] = depth.ravel()
    met, rings = np.isfinite(depth.ravel()), RING.ravel()
    return [points[met & (rings == ring)] @ np.asarray(rotation).T + position for ring in RINGS]


def project_batch(
    touch: Path | str, surface: Callable[[str, Sensor], MeshSurface | CloudSurface]
) -> dict[str, np.ndarray]:
    """The arrays of a batch's rings store: rings around every successful touch. touch: the batch's touch store;
    surface: from an object's name and the sensor to what its rings are projected onto."""
    touches, kind = store.read(touch, "object", "success", "position", "rotation"), store.open(touch).sensor
    names, success = touches["object"], touches["success"]
    depth = np.full((*success.shape, GRID, GRID), np.inf, dtype=np.float32)
    for place, name in enumerate(names):
        log.info("rings %d/%d: %s", place + 1, len(names), name)
        onto = surface(str(name), kind)
        for grasp, sensor in zip(*np.nonzero(success[place]), strict=True):
            index = place, grasp, sensor
            depth[index] = onto.project(touches["position"][index], touches["rotation"][index])
    return {"object": names, "ring_depth": depth}
