"""Distance of a surface from another."""

import numpy as np
from trimesh.remesh import subdivide

from palpate.mesh.distance import Surface

SAMPLES = 8_000
ROUNDS, FIRST, BEAM = 6, 4000, 250  # of the search for the largest distance; triangles in the first, and in each later


def sample(vertices: np.ndarray, faces: np.ndarray, count: int) -> np.ndarray:
    """`count` points (count, 3) spread evenly by area, always the same: equal steps of the summed area, and within the
    triangle the additive recurrence of the plastic number (Roberts 2018, R2 sequence)."""
    corner = vertices[faces]
    total = np.cumsum(np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1))
    face = np.minimum(np.searchsorted(total, (np.arange(count) + 0.5) / count * total[-1]), len(faces) - 1)
    plastic = 1.32471795724474602596
    u, v = (np.arange(1, count + 1)[None] * np.array([[1 / plastic], [1 / plastic**2]])) % 1
    over = u + v > 1
    u, v = np.where(over, 1 - u, u)[:, None], np.where(over, 1 - v, v)[:, None]
    corner = corner[face]
    return corner[:, 0] + u * (corner[:, 1] - corner[:, 0]) + v * (corner[:, 2] - corner[:, 0])


def distances(one: Surface, other: Surface) -> tuple[float, float]:
    """Distances from one surface to another, mean over the area of the first and largest: at points spread evenly,
    at corners, and, finer and finer, at the middles of the triangles whose corners, then middles, are farthest."""
    spread, _ = other.closest(sample(one.vertices, one.faces, SAMPLES))
    corners = other.closest(one.vertices)[0][one.faces]
    largest = max(spread.max(), corners.max())
    triangles = one.vertices[one.faces[np.argsort(-corners.sum(axis=1), kind="stable")[:FIRST]]]
    for _ in range(ROUNDS):
        away, _ = other.closest(triangles.mean(axis=1))
        largest = max(largest, away.max())
        points = triangles[np.argsort(-away, kind="stable")[:BEAM]].reshape(-1, 3)
        points, faces = subdivide(points, np.arange(len(points)).reshape(-1, 3))
        triangles = points[faces]
    return float(spread.mean()), float(largest)
