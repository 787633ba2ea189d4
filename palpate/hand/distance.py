"""Signed distances of points to solids in their own frame, in closed form: negative inside, metres."""

import numpy as np

GEOM_KINDS = ("box", "sphere", "capsule", "cylinder", "ellipsoid", "mesh")


def signed_distance(kind: str, size: np.ndarray, points: np.ndarray, planes: np.ndarray) -> np.ndarray:
    """Signed distance (N,) of points (N, 3) to a geom in its own frame.

    size: (3,) as in `Hand`; planes: (P, 4) of a mesh, see `half_spaces`. Exact for box, sphere, capsule and cylinder.
    For an ellipsoid along the ray from its centre, at most the smallest half axis deep: never nearer to zero than the
    true one, so penetration is never understated. For a mesh exact inside, and outside never farther than the true one.
    """
    if kind == "mesh":
        return (points @ planes[:, :3].T + planes[:, 3]).max(axis=1)
    if kind == "sphere":
        return np.linalg.norm(points, axis=1) - size[0]
    if kind == "box":
        excess = np.abs(points) - size
        return np.linalg.norm(np.maximum(excess, 0), axis=1) + np.minimum(excess.max(axis=1), 0)
    if kind == "ellipsoid":
        length, scaled = np.linalg.norm(points, axis=1), np.linalg.norm(points / size, axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            along_ray = np.where(scaled > 0, length * (1 - 1 / scaled), -np.inf)
        return np.maximum(along_ray, -np.min(size))
    radius, half_length, _ = size
    if kind == "capsule":
        along = np.clip(points[:, 2], -half_length, half_length)
        return np.linalg.norm(points - along[:, None] * np.array([0.0, 0.0, 1.0]), axis=1) - radius
    radial, axial = np.linalg.norm(points[:, :2], axis=1) - radius, np.abs(points[:, 2]) - half_length
    outside = np.hypot(np.maximum(radial, 0), np.maximum(axial, 0))
    return outside + np.minimum(np.maximum(radial, axial), 0)


def half_spaces(vertices: np.ndarray) -> np.ndarray:
    """The convex hull of vertices (V, 3) as half spaces (P, 4): normal n and offset, n . x + offset < 0 inside."""
    from scipy.spatial import ConvexHull

    return np.unique(np.round(ConvexHull(vertices).equations, 9), axis=0)
