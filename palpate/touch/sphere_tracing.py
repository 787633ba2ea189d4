"""Depth maps by sphere tracing on the distance field of the mesh: the paper's method."""

import igl
import numpy as np

from palpate.touch.sensor import SENSOR_PLANE, SENSOR_RANGE
from palpate.touch.tracing import Block, Tracer

# A point this close to the surface has arrived, metres.
TOLERANCE = 1e-5
# Steps after which a ray that has neither arrived nor left the range is given up as a miss.
MAX_STEPS = 200


class SphereTracer(Tracer):
    """Depth maps by sphere tracing (Hart 1996): each point advances by its distance to the object until it
    arrives.

    The distance is unsigned and exact (libigl's tree of boxes over the faces), so open meshes are felt as
    closed ones are; outside a closed mesh the signed distance takes the same steps. A ray that arrives stops
    short of the surface by up to `tolerance` / cos(angle of incidence), and one that only passes within
    `tolerance` of an edge counts as a hit. Error against time: docs/touch.md.
    """

    def __init__(self, mesh, object_position=(0.0, 0.0, 0.0), tolerance=TOLERANCE, max_steps=MAX_STEPS):
        super().__init__(mesh, object_position)
        self._tolerance, self._max_steps = tolerance, max_steps
        self._vertices = np.ascontiguousarray(self._scene.triangles.reshape(-1, 3))
        self._faces = np.arange(len(self._vertices), dtype=np.int64).reshape(-1, 3)
        self._tree = igl.AABB()
        self._tree.init(self._vertices, self._faces)

    def _depth(self, origin, rotation, block: Block) -> np.ndarray:
        plane = SENSOR_PLANE[block]
        start = plane.reshape(-1, 3) @ rotation.T + origin
        travelled = np.zeros(len(start))
        moving = np.arange(len(start))
        for _ in range(self._max_steps):
            points = start[moving] + travelled[moving, None] * rotation[:, 0]
            squared, _, _ = self._tree.squared_distance(self._vertices, self._faces, points)
            distance = np.sqrt(squared)
            moving, distance = moving[distance > self._tolerance], distance[distance > self._tolerance]
            travelled[moving] += distance
            moving = moving[travelled[moving] <= SENSOR_RANGE]
            if not len(moving):
                break
        travelled[moving] = np.inf
        return travelled.reshape(plane.shape[:2])
