"""Signed distances of points to solids in their own frame, in closed form: negative inside, metres."""

import numpy as np

GEOM_KINDS = ("box", "sphere", "capsule", "cylinder", "ellipsoid", "mesh")


def signed_distance(kind: str, size: np.ndarray, points: np.ndarray, planes: np.ndarray) -> np.ndarray:
    """Signed distance (N,) of points (N, 3) to a geom in its own frame.

    size: (3,) as in `Hand`; planes: (P, 4) of a mesh, see `half_spaces`.

    Exact for box, sphere, capsule and cylinder. For an ellipsoid the distance along the ray from its centre:
    never nearer to zero than the true one, so penetration is never understated. For a mesh (convex, given by
    half spaces) exact inside; outside, never farther than the true one.
    """
    if kind == "box":
        return box(points, size)
    if kind == "sphere":
        return np.linalg.norm(points, axis=1) - size[0]
    if kind == "capsule":
        return capsule(points, size[0], size[1])
    if kind == "cylinder":
        return cylinder(points, size[0], size[1])
    if kind == "ellipsoid":
        return ellipsoid(points, size)
    return (points @ planes[:, :3].T + planes[:, 3]).max(axis=1)


def box(points: np.ndarray, half_extents: np.ndarray) -> np.ndarray:
    """Distance to a box: the outside part by components, the inside one by the nearest face."""
    excess = np.abs(points) - half_extents
    return np.linalg.norm(np.maximum(excess, 0), axis=1) + np.minimum(excess.max(axis=1), 0)


def capsule(points: np.ndarray, radius: float, half_length: float) -> np.ndarray:
    """Distance to the segment on the z axis, less the radius."""
    along = np.clip(points[:, 2], -half_length, half_length)
    offset = points - along[:, None] * np.array([0.0, 0.0, 1.0])
    return np.linalg.norm(offset, axis=1) - radius


def cylinder(points: np.ndarray, radius: float, half_length: float) -> np.ndarray:
    """A rectangle's distance in the half plane (distance from the z axis, height)."""
    radial = np.linalg.norm(points[:, :2], axis=1) - radius
    axial = np.abs(points[:, 2]) - half_length
    outside = np.hypot(np.maximum(radial, 0), np.maximum(axial, 0))
    return outside + np.minimum(np.maximum(radial, axial), 0)


def ellipsoid(points: np.ndarray, half_axes: np.ndarray) -> np.ndarray:
    """Distance to an ellipsoid along the ray from its centre, at most the smallest half axis deep."""
    length = np.linalg.norm(points, axis=1)
    scaled = np.linalg.norm(points / half_axes, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        along_ray = np.where(scaled > 0, length * (1 - 1 / scaled), -np.inf)
    return np.maximum(along_ray, -np.min(half_axes))


def half_spaces(vertices: np.ndarray) -> np.ndarray:
    """The convex hull of vertices (V, 3) as half spaces (P, 4).

    Outward unit normal and offset: normal . x + offset is negative inside.
    """
    from scipy.spatial import ConvexHull

    equations = ConvexHull(vertices).equations
    return np.unique(np.round(equations, 9), axis=0)
