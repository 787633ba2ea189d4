"""Polygons of any number of corners, concave or with holes, as triangles."""

from collections.abc import Sequence

import manifold3d
import numpy as np

FLAT = 1e-9  # of the square of a polygon's size: a corner with a smaller sine is straight


def triangulate(vertices: np.ndarray, corners: np.ndarray, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Triangles of polygons without holes, in their order.

    vertices (n, 3); corners: vertex numbers of all polygons, one after the other; counts (p,): corners of each.
    Returns (t, 3) places in `corners`, so that other attributes of corners follow, and the polygon (t,) of each
    triangle. Polygons of fewer than three corners have none. A convex one is a fan from its first corner; every corner
    stays a corner of a triangle, so that what is closed stays closed.
    """
    counts = np.asarray(counts, dtype=np.int64)
    first = np.cumsum(counts) - counts
    triangles, owner = [np.zeros((0, 3), np.int64)], [np.zeros(0, np.int64)]
    for count in np.unique(counts[counts >= 3]):
        index = np.flatnonzero(counts == count)
        place = first[index, None] + np.arange(count)  # (k, count)
        fan = np.stack([np.zeros(count - 2, np.int64), np.arange(1, count - 1), np.arange(2, count)], axis=1)
        convex = np.ones(len(index), bool) if count == 3 else is_convex(vertices[corners[place]])
        triangles.append((place[convex][:, fan]).reshape(-1, 3))
        owner.append(np.repeat(index[convex], count - 2))
        for polygon, at in zip(index[~convex], place[~convex], strict=True):
            made = at[with_holes([vertices[corners[at]]])]
            triangles.append(made)
            owner.append(np.full(len(made), polygon))
    triangles, owner = np.concatenate(triangles), np.concatenate(owner)
    order = np.argsort(owner, kind="stable")
    return triangles[order], owner[order]


def is_convex(polygons: np.ndarray) -> np.ndarray:
    """Which polygons (p, c, 3) are convex, (p,) bool: they turn to one side at each corner, once around in all."""
    edge = np.roll(polygons, -1, axis=1) - polygons
    turn = np.cross(edge, np.roll(edge, -1, axis=1))
    normal = _normal(polygons)
    size = np.square(edge).sum(axis=2).max(axis=1)
    sine = np.einsum("pcx,px->pc", turn, normal)
    # Once around: seen from the first corner, all others follow each other, too.
    spoke = polygons[:, 1:] - polygons[:, :1]
    fan = np.einsum("pcx,px->pc", np.cross(spoke[:, :-1], spoke[:, 1:]), normal)
    return (np.concatenate([sine, fan], axis=1) > FLAT * size[:, None]).all(axis=1)


def with_holes(rings: Sequence[np.ndarray]) -> np.ndarray:
    """Triangles (t, 3) of one polygon: its outline (n, 3), then its holes (m, 3), wound either way. They are numbers
    in all rings' corners together, and wound as the outline; each corner is one of some triangle."""
    normal = _normal(rings[0][None])[0]
    across = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    across /= max(np.linalg.norm(across), 1e-300)
    origin = rings[0][0]
    axes = np.stack([across, np.cross(normal, across)], axis=1) / max(np.abs(rings[0] - origin).max(), 1e-300)
    flat = [(ring - origin) @ axes for ring in rings]
    first, numbers, sent = 0, [], []
    for number, ring in enumerate(flat):
        order = np.arange(len(ring))
        if number and _area(ring) > 0:
            order = order[::-1]
        numbers.append(first + order)
        sent.append(np.ascontiguousarray(ring[order]))
        first += len(ring)
    return np.concatenate(numbers)[np.asarray(manifold3d.triangulate(sent), dtype=np.int64).reshape(-1, 3)]


def _normal(polygons):
    """Unit normals (p, 3) of polygons (p, c, 3), by Newell's method; 0 of those without an area."""
    corner = polygons - polygons[:, :1]
    corner = corner / np.maximum(np.abs(corner).max(axis=(1, 2), keepdims=True), 1e-300)
    normal = np.cross(corner, np.roll(corner, -1, axis=1)).sum(axis=1)
    return normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]


def _area(ring):
    following = np.roll(ring, -1, axis=0)
    return (ring[:, 0] * following[:, 1] - ring[:, 1] * following[:, 0]).sum() / 2
