"""Distance of a surface from another."""

import numpy as np

from palpate.mesh.distance import Surface

SAMPLES = 200_000


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
    """From one surface to another, the mean over the area of the first, and the largest, at its corners too."""
    points = np.concatenate([sample(one.vertices, one.faces, SAMPLES), one.vertices[np.unique(one.faces)]])
    found, _ = other.closest(points)
    return float(found[:SAMPLES].mean()), float(found.max())
