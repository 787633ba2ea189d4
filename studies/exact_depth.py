"""Depth of a touch sensor's rays by testing every face: a reference that shares no code with the tracers."""

import numpy as np

from palpate.touch import PIXEL_CENTRES, SENSOR_RANGE

Y, Z = np.meshgrid(PIXEL_CENTRES, PIXEL_CENTRES)
PIXELS = np.stack([Y.ravel(), Z.ravel()], axis=1)  # (10000, 2) of the DIGIT, in the sensor's plane, metres
WIDTH = 1e-12  # m, of an edge


def exact_depth(
    triangles: np.ndarray,
    position: np.ndarray,
    rotation: np.ndarray,
    pixels: np.ndarray = PIXELS,
    low: float = 0.0,
    high: float = SENSOR_RANGE,
) -> np.ndarray:
    """Depth (n,) of the nearest of triangles (f, 3, 3), between low and high, at each of pixels (n, 2); else +inf.

    Uses barycentric coordinates in the sensor plane, in double precision (or longer, as the triangles), of every face
    that is not exactly edge-on. Edges count as `WIDTH` wide. position: (3,), rotation: (3, 3) of the sensor, in the
    triangles' frame.
    """
    corner = (np.asarray(triangles, dtype=np.result_type(triangles, np.float64)) - position) @ rotation
    a, ab, ac = corner[:, 0], corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    twice = ab[:, 1] * ac[:, 2] - ab[:, 2] * ac[:, 1]
    left, right = corner[:, :, 1].min(axis=1) - 1e-9, corner[:, :, 1].max(axis=1) + 1e-9
    depth = np.full(len(pixels), np.inf, dtype=corner.dtype)
    for y in np.unique(pixels[:, 0]):
        column = np.flatnonzero(pixels[:, 0] == y)
        f = np.flatnonzero((left <= y) & (y <= right) & (twice != 0))
        away = pixels[column, None] - a[f, 1:]
        u = (away[..., 0] * ac[f, 2] - away[..., 1] * ac[f, 1]) / twice[f]
        v = (ab[f, 1] * away[..., 1] - ab[f, 2] * away[..., 0]) / twice[f]
        covered = np.ones(u.shape, dtype=bool)
        for share, edge in ((u, ac[f]), (v, ab[f]), (1 - u - v, (ac - ab)[f])):
            covered &= share >= -WIDTH * np.linalg.norm(edge[:, 1:], axis=1) / np.abs(twice[f])
        met = a[f, 0] + np.clip(u, 0, 1) * ab[f, 0] + np.clip(v, 0, 1) * ac[f, 0]
        covered &= (met >= low) & (met <= high)
        depth[column] = np.where(covered, met, np.inf).min(axis=1, initial=np.inf)
    return depth
