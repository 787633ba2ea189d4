"""Depth maps by sphere tracing on the distance field of the mesh: the paper's method."""

import igl
import numpy as np

from palpate.sensor import DIGIT, Sensor
from palpate.touch.tracing import Block, Tracer

TOLERANCE = 1e-5  # metres: a point this close to the surface has arrived
# A face whose height is less than this share of its longest edge is traced as that edge: libigl's distance to such
# needles is wrong (by centimetres at 1e-6), while the edge is at most this share of its length off.
_NEEDLE = 1e-4


class SphereTracer(Tracer):
    """Sphere tracing (Hart 1996): each point advances by its distance to the object until it arrives.

    The distance is unsigned and exact (libigl's tree of boxes over the faces): open meshes are traced too, and outside
    a closed mesh the signed distance takes the same steps. A ray stops short of the surface by up to `tolerance` /
    cos(angle of incidence), and passing within `tolerance` of an edge is a hit. Error against time:
    docs/evidence/error_vs_runtime.md.
    """

    def __init__(
        self, mesh, object_position=(0.0, 0.0, 0.0), tolerance=TOLERANCE, max_steps=None, sensor: Sensor = DIGIT
    ):
        """As for `Tracer`; `tolerance` in metres. A ray that has not arrived after `max_steps` is a miss; by default it
        has left the range by then, for each step is longer than the tolerance."""
        super().__init__(mesh, object_position, sensor)
        self._tolerance = tolerance
        self._max_steps = int(sensor.range / tolerance) + 2 if max_steps is None else max_steps
        self._vertices = np.ascontiguousarray(self._mesh.triangles.reshape(-1, 3))
        self._faces = self._without_needles()
        self._tree = igl.AABB()
        self._tree.init(self._vertices, self._faces)

    def _without_needles(self) -> np.ndarray:
        """(f, 3) int64 faces; a needle is written i, j, j, which libigl reads as a segment."""
        faces = np.arange(len(self._vertices), dtype=np.int64).reshape(-1, 3)
        triangles = self._mesh.triangles
        length = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
        longest = length.argmax(axis=1)
        height = np.linalg.norm(self._mesh.normals, axis=1) / length.max(axis=1)
        needle = np.flatnonzero(height < _NEEDLE * length.max(axis=1))
        start, stop = faces[needle, longest[needle]], faces[needle, (longest[needle] + 1) % 3]
        faces[needle] = np.stack([start, stop, stop], axis=1)
        return faces

    def _depth(self, origin, rotation, block: Block) -> np.ndarray:
        plane = self.sensor.plane[block]
        start = plane.reshape(-1, 3) @ rotation.T + origin
        travelled = np.zeros(len(start))
        moving = np.arange(len(start))
        for _ in range(self._max_steps):
            points = start[moving] + travelled[moving, None] * rotation[:, 0]
            squared, _, _ = self._tree.squared_distance(self._vertices, self._faces, points)
            distance = np.sqrt(squared)
            moving, distance = moving[distance > self._tolerance], distance[distance > self._tolerance]
            travelled[moving] += distance
            moving = moving[travelled[moving] <= self.sensor.range]
            if not len(moving):
                break
        travelled[moving] = np.inf
        return travelled.reshape(plane.shape[:2])
