"""Exact distances of points to a surface."""

import igl
import numpy as np


class Surface:
    """A triangle mesh prepared for closest-point queries: vertices (n, 3), faces (f, 3)."""

    def __init__(self, vertices: np.ndarray, faces: np.ndarray):
        self.vertices = np.ascontiguousarray(vertices, dtype=np.float64)
        self.faces = np.ascontiguousarray(faces, dtype=np.int64)
        self.tree = igl.AABB()
        self.tree.init(self.vertices, self.faces)

    def closest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Exact distance (k,) of points (k, 3) to the surface, and its nearest points (k, 3)."""
        points = np.ascontiguousarray(points)
        squared, _, nearest = self.tree.squared_distance(self.vertices, self.faces, points)
        return np.sqrt(squared), nearest


def hausdorff(one: Surface, other: Surface) -> float:
    """Hausdorff distance of two surfaces, found at the vertices and the middles of faces of each, m."""
    return max(_farthest(one, other), _farthest(other, one))


def _farthest(one: Surface, other: Surface) -> float:
    places = np.concatenate([one.vertices[np.unique(one.faces)], one.vertices[one.faces].mean(axis=1)])
    return float(other.closest(places)[0].max())
