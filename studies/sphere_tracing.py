"""Depth maps by sphere tracing on the distance field of the mesh: the paper's method, to compare with."""

import numpy as np

from palpate.mesh import Geometry
from palpate.mesh.distance import Surface
from palpate.touch import RayCaster

TOLERANCE = 1e-5  # metres: a point this close to the surface has arrived


class SphereTracer(RayCaster):
    """Sphere tracing (Hart 1996): each point advances by its distance to the object until it arrives.

    The distance is unsigned and exact (libigl's tree of boxes over the faces; of faces much thinner than long it is
    wrong): open meshes are traced too, and outside a closed mesh the signed distance takes the same steps. A ray stops
    short of the surface by up to `tolerance` / cos(angle of incidence), and passing within `tolerance` of an edge is a
    hit.
    """

    def __init__(self, mesh: Geometry, tolerance: float = TOLERANCE):
        """mesh: as for `RayCaster`. tolerance: metres."""
        super().__init__(mesh)
        self._tolerance = tolerance
        vertices = self.mesh.triangles.reshape(-1, 3)
        self._surface = Surface(vertices, np.arange(len(vertices)).reshape(-1, 3))

    def depth(self, origin: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """Way (r, c) of each ray until it arrives, or beyond the sensor's range."""
        start = self.sensor.plane.reshape(-1, 3) @ rotation.T + origin
        travelled = np.zeros(len(start))
        moving = np.arange(len(start))
        while len(moving):  # each step is longer than the tolerance
            distance, _ = self._surface.closest(start[moving] + travelled[moving, None] * rotation[:, 0])
            moving, distance = moving[distance > self._tolerance], distance[distance > self._tolerance]
            travelled[moving] += distance
            moving = moving[travelled[moving] <= self.sensor.range]
        return travelled.reshape(self.sensor.resolution)
