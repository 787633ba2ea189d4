"""Distance between two surfaces: the mean, and the largest found."""

import numpy as np

from palpate.mesh.distance import Surface

SAMPLES = 8_000
ROUNDS, FIRST, BEAM = 6, 4000, 250  # of the search for the largest distance; triangles in the first, and in each later


def sample(vertices: np.ndarray, faces: np.ndarray, count: int) -> np.ndarray:
    """`count` points (count, 3) spread evenly by area, always the same: equal steps of the summed area, and within the
    triangle the additive recurrence of the plastic number (Roberts 2018, R2 sequence)."""
    corner = vertices[faces]
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    total = np.cumsum(area)
    step = (np.arange(count) + 0.5) / count
    face = np.minimum(np.searchsorted(total, step * total[-1]), len(faces) - 1)
    plastic = 1.32471795724474602596
    u, v = (np.arange(1, count + 1)[None] * np.array([[1 / plastic], [1 / plastic**2]])) % 1
    over = u + v > 1
    u, v = np.where(over, 1 - u, u)[:, None], np.where(over, 1 - v, v)[:, None]
    corner = corner[face]
    return corner[:, 0] + u * (corner[:, 1] - corner[:, 0]) + v * (corner[:, 2] - corner[:, 0])


def distances(one: Surface, other: Surface) -> tuple[dict[str, float], dict[str, float]]:
    """Distance of two surfaces, from the first to the second and back: `mean` over the area of the surface that it
    starts from (sampled), and `max`, the largest found.

    Of points spread evenly by area, the corners, the points nearest to the other surface's corners, and, finer and
    finer, the triangles whose middle is farthest, beginning with those whose corners are.
    """
    from_one, from_other = (b.closest(a.vertices[np.unique(a.faces)]) for a, b in ((one, other), (other, one)))
    return _distance(one, other, from_one[0], *from_other), _distance(other, one, from_other[0], *from_one)


def _distance(source: Surface, target: Surface, corners, back, feet) -> dict[str, float]:
    """One way of `distances`. corners: distances of the source's corners; back: those of the target's corners, and
    feet, the source's points nearest to them."""
    spread, _ = target.closest(sample(source.vertices, source.faces, SAMPLES))
    largest = max(spread.max(), corners.max())
    # A foot is no farther from the target than the corner that it belongs to is from it.
    farther = feet[back > largest]
    if len(farther):
        largest = max(largest, target.closest(farther)[0].max())
    at_corner = np.zeros(len(source.vertices))
    at_corner[np.unique(source.faces)] = corners
    order = np.argsort(-at_corner[source.faces].sum(axis=1), kind="stable")
    triangles = source.vertices[source.faces[order[:FIRST]]]
    for _ in range(ROUNDS):
        found, _ = target.closest(triangles.mean(axis=1))
        largest = max(largest, found.max())
        a, b, c = triangles[np.argsort(-found, kind="stable")[:BEAM]].swapaxes(0, 1)
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        quarters = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        triangles = np.concatenate([np.stack(quarter, axis=1) for quarter in quarters])
    return {"mean": float(spread.mean()), "max": float(largest)}
