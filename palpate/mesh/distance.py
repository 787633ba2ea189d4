"""How far two surfaces are from each other, measured: mean, largest found, and a bound that holds
everywhere."""

import igl
import numpy as np

SAMPLES = 20_000

# The bound is refined until it is within this share, or within this length (metres), of the largest distance
# found, or until this many triangles have been looked at.
RELATIVE_GAP = 0.05
ABSOLUTE_GAP = 1e-5
WORK = 100_000


class Surface:
    """A triangle mesh prepared for closest-point queries: vertices (n, 3), faces (f, 3)."""

    def __init__(self, vertices: np.ndarray, faces: np.ndarray):
        self.vertices = np.ascontiguousarray(vertices, dtype=np.float64)
        self.faces = np.ascontiguousarray(faces, dtype=np.int64)
        self.tree = igl.AABB()
        self.tree.init(self.vertices, self.faces)

    def closest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Exact distance (k,) of points (k, 3) to the surface, and the nearest face (k,)."""
        squared, face, _ = self.tree.squared_distance(self.vertices, self.faces, np.ascontiguousarray(points))
        return np.sqrt(squared), face


def sample(vertices: np.ndarray, faces: np.ndarray, count: int) -> np.ndarray:
    """`count` points (count, 3) spread evenly by area, the same ones every time: equal steps of the summed
    area, and within the triangle the additive recurrence of the plastic number (Roberts 2018, R2
    sequence)."""
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


def distance(source: Surface, target: Surface, samples: int = SAMPLES) -> dict[str, float]:
    """Distance from `source` to `target`: `mean` over the area (sampled), `max` (the largest that was found),
    `max_bound` (no point of `source` is farther than this)."""
    spread, _ = target.closest(sample(source.vertices, source.faces, samples))
    corners, _ = target.closest(source.vertices)
    used = np.unique(source.faces)
    largest = max(spread.max(), corners[used].max())
    largest, bound = _bound(source.vertices[source.faces], target, largest)
    return {"mean": float(spread.mean()), "max": float(largest), "max_bound": float(bound)}


def _bound(triangles: np.ndarray, target: Surface, largest: float) -> tuple[float, float]:
    """Largest distance found and upper bound over triangles (f, 3, 3), by branch and bound.

    The distance to one face of the target is convex, so over a triangle it is largest at a corner; hence over
    the triangle the distance to the target is at most the largest corner distance to any one face. And it
    changes by no more than one moves. Triangles for which neither shows that they can't beat the largest
    distance found are cut in four.
    """
    work = 0
    while True:
        centre = triangles.mean(axis=1)
        found, face = target.closest(centre)
        largest = max(largest, found.max(initial=0.0))
        radius = np.linalg.norm(triangles - centre[:, None], axis=2).max(axis=1)
        enough = max(largest * (1 + RELATIVE_GAP), largest + ABSOLUTE_GAP)
        bound = found + radius
        open_ = np.flatnonzero(bound > enough)
        corner = target.vertices[target.faces[face[open_]]]
        bound[open_] = np.minimum(bound[open_], _corner_distance(triangles[open_], corner))
        open_ = np.flatnonzero(bound > enough)
        work += len(triangles)
        if not len(open_) or work + 4 * len(open_) > WORK:
            return largest, max(largest, bound.max(initial=0.0), 0.0 if not len(open_) else enough)
        triangles = _quarter(triangles[open_])


def _quarter(triangles):
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    quarters = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.concatenate([np.stack(quarter, axis=1) for quarter in quarters])


def _corner_distance(triangles, faces):
    """Largest distance (k,) of the corners of triangles (k, 3, 3) to the face (k, 3, 3) of the same row."""
    return np.max([point_triangle_distance(triangles[:, i], faces) for i in range(3)], axis=0, initial=0.0)


def point_triangle_distance(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Distance (k,) of each point (k, 3) to the triangle (k, 3, 3) of the same row."""
    side = np.roll(triangles, -1, axis=1) - triangles
    to = points[:, None] - triangles
    along = np.einsum("ijk,ijk->ij", to, side) / np.maximum(np.einsum("ijk,ijk->ij", side, side), 1e-300)
    offset = to - np.clip(along, 0, 1)[:, :, None] * side
    squared = np.einsum("ijk,ijk->ij", offset, offset).min(axis=1)
    normal = np.cross(side[:, 0], side[:, 1])
    inside = (np.einsum("ijk,ijk->ij", np.cross(normal[:, None], side), to) >= 0).all(axis=1)
    height = np.einsum("ij,ij->i", to[:, 0], normal)
    length = np.einsum("ij,ij->i", normal, normal)
    inside &= length > 0
    plane = height**2 / np.maximum(length, 1e-300)
    return np.sqrt(np.where(inside, np.minimum(plane, squared), squared))
