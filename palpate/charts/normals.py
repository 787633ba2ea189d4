"""Normals of a cloud of points. The surface stores have none."""

import numpy as np
from scipy.spatial import cKDTree

# Points of a plane through the surface: 10,000 points on 0.2 m^2 then have planes 1 cm wide.
PLANE_POINTS = 16


def plane_normals(points: np.ndarray, tree: cKDTree) -> np.ndarray:
    """Unit normals (n, 3), of either sign, of the planes that fit a cloud best around some points. points: (n, 3).
    tree: of the cloud, in the same frame; the plane at a point is laid through the cloud's nearest `PLANE_POINTS`
    (Hoppe et al. 1992, Surface Reconstruction from Unorganized Points). The sign is not known on thin objects, and is
    left open."""
    _, near = tree.query(points, k=min(PLANE_POINTS, tree.n))
    around = tree.data[near]
    around = around - around.mean(axis=1, keepdims=True)
    _, axes = np.linalg.eigh(np.swapaxes(around, 1, 2) @ around)
    return axes[:, :, 0]  # eigenvalues rise: the direction in which the points spread least
