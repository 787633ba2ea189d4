"""Exterior points from orthographic depth maps, the paper's technique: Smith et al., "Multi-View Silhouette and Depth
Decomposition for High Resolution 3D Object Representation" (2018).

The object is seen from the six sides of its bounding box. A pixel stands for the more surface the more obliquely it
meets it, and for the less the more maps see it: drawn by these weights, points are uniform by area.
"""

import numpy as np

from palpate.surface.embree import RayMesh

VIEWS = np.concatenate([np.eye(3), -np.eye(3)])  # directions of view: along the axes, both ways
RESOLUTION = 256  # pixels along the longer edge of each depth map
_GRAZING = 0.05  # least cosine of incidence in weights: one pixel on a surface seen edge-on must not outweigh hundreds


def sample_by_depth_maps(
    mesh: RayMesh, count: int, rng: np.random.Generator, resolution: int = RESOLUTION, views: np.ndarray = VIEWS
) -> np.ndarray:
    """(count, 3) float64 points on what the depth maps see, uniform by area; repeated only if they see fewer.

    Raises ValueError if they see none: a surface in needles thinner than a pixel.
    """
    maps = [DepthMap(mesh, view, resolution, rng) for view in views]
    points = np.concatenate([depth_map.points for depth_map in maps])
    if not len(points):
        thin = f"it is thinner than a pixel of {resolution} x {resolution}; use the method rays"
        raise ValueError(f"the depth maps see nothing of the surface: {thin}")
    normals = np.concatenate([depth_map.normals for depth_map in maps])
    weight = 1 / sum(depth_map.density(points, normals) for depth_map in maps)
    chosen = rng.choice(len(points), size=count, replace=len(points) < count, p=weight / weight.sum())
    return points[chosen]


class DepthMap:
    """One orthographic view of a mesh; each pixel looks at a random spot of its square.

    points, normals: (n, 3) float64, what the pixels see, and unit normals of the faces, of either sign.
    """

    def __init__(self, mesh: RayMesh, view: np.ndarray, resolution: int, rng: np.random.Generator):
        """view: (3,) unit vector, the way the camera looks. resolution: pixels along the longer edge."""
        # The camera's frame: two axes across, the third along the view.
        self._axes = np.linalg.svd(view[None])[2][[1, 2, 0]].T
        self._axes[:, 2] = view
        corners = mesh.triangles.reshape(-1, 3) @ self._axes
        self._low, high = corners.min(axis=0), corners.max(axis=0)
        self._pixel = max(high[:2] - self._low[:2]) / resolution
        shape = np.maximum(np.ceil((high[:2] - self._low[:2]) / self._pixel).astype(int), 1)
        self._depth = np.full(shape, np.inf)

        pixel = np.indices(shape).reshape(2, -1).T
        spot = self._low[:2] + (pixel + rng.random(pixel.shape)) * self._pixel
        outside = self._low[2] - max(high - self._low)
        start = np.column_stack([spot, np.full(len(spot), outside)]) @ self._axes.T
        hit = mesh.first_face(start, view[None])
        seen = np.flatnonzero(hit >= 0)
        face, start = hit[seen], start[seen]
        normal = mesh.normals[face] / np.linalg.norm(mesh.normals[face], axis=1, keepdims=True)
        across = normal @ view
        # A face seen edge-on has no area in the map; Embree may still name it.
        facing = np.abs(across) > 1e-6
        seen, face, start, normal, across = (array[facing] for array in (seen, face, start, normal, across))
        distance = np.einsum("ni,ni->n", mesh.triangles[face, 0] - start, normal) / across
        self.points = start + distance[:, None] * view
        self.normals = normal
        self._view = view
        self._depth.ravel()[seen] = distance + outside

    def density(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Points per area (n,) of this map at (n, 3) points with (n, 3) normals; 0 where its depth is not the point's,
        up to the slope within a pixel."""
        place = points @ self._axes
        pixel = ((place[:, :2] - self._low[:2]) / self._pixel).astype(int)
        pixel = np.clip(pixel, 0, np.array(self._depth.shape) - 1)
        cosine = np.maximum(np.abs(normals @ self._view), _GRAZING)
        # Two spots of a pixel are at most sqrt(2) pixels apart.
        tolerance = self._pixel * np.sqrt(2 * (1 / cosine**2 - 1)) + 1e-3 * self._pixel
        seen = np.abs(self._depth[pixel[:, 0], pixel[:, 1]] - place[:, 2]) <= tolerance
        return np.where(seen, cosine / self._pixel**2, 0)
