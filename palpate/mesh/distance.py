"""How far two surfaces are from each other, measured: mean, largest found, and a bound that always holds."""

import igl
import numpy as np

from palpate.mesh import topology

SAMPLES = 8_000

# The search for the largest distance goes on so many times with so many triangles.
ROUNDS, BEAM = 6, 250

# A bound is refined until it is within this share, or this length (metres), of the largest distance found.
RELATIVE_GAP = 0.1
ABSOLUTE_GAP = 5e-5


class Surface:
    """A triangle mesh prepared for closest-point queries: vertices (n, 3), faces (f, 3)."""

    def __init__(self, vertices: np.ndarray, faces: np.ndarray):
        self.vertices = np.ascontiguousarray(vertices, dtype=np.float64)
        self.faces = np.ascontiguousarray(faces, dtype=np.int64)
        self.neighbours, self.opposite = topology.neighbours(self.faces)
        self.corners = self.vertices[np.unique(self.faces)]
        self.tree = igl.AABB()
        self.tree.init(self.vertices, self.faces)

    def closest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Exact distance (k,) of points (k, 3) to the surface, its nearest face (k,) and point (k, 3)."""
        points = np.ascontiguousarray(points)
        squared, face, nearest = self.tree.squared_distance(self.vertices, self.faces, points)
        return np.sqrt(squared), face, nearest


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


def distance(source: Surface, target: Surface, samples: int = SAMPLES, work: int = 0) -> dict[str, float]:
    """Distance from `source` to `target`: `mean` over the area (sampled) and `max`, the largest found.

    Looked at are points spread evenly by area, the source's corners, the points of the source nearest to the
    target's corners, and, finer and finer, the triangles whose middle is farthest.

    With `work`, branch and bound over so many triangles refines `max` and adds `max_bound`: no point of the
    source is farther than this.
    """
    spread, _, _ = target.closest(sample(source.vertices, source.faces, samples))
    _, _, feet = source.closest(target.corners)
    largest = max(spread.max(), target.closest(source.corners)[0].max(), target.closest(feet)[0].max())
    largest = _climb(source.vertices[source.faces], target, largest)
    record = {"mean": float(spread.mean()), "max": float(largest)}
    if work:
        largest, bound = _bound(source.vertices[source.faces], target, largest, work)
        record |= {"max": float(largest), "max_bound": float(bound)}
    return record


def _climb(triangles: np.ndarray, target: Surface, largest: float) -> float:
    """The largest distance found by cutting in four those triangles (f, 3, 3) whose middles are farthest."""
    for _ in range(ROUNDS):
        found, _, _ = target.closest(triangles.mean(axis=1))
        largest = max(largest, found.max())
        triangles = _quarter(triangles[np.argsort(-found, kind="stable")[:BEAM]])
    return largest


def _bound(triangles: np.ndarray, target: Surface, largest: float, work: int) -> tuple[float, float]:
    """Largest distance found and upper bound over triangles (f, 3, 3), by branch and bound.

    Triangles for which no bound shows that they can't beat the largest distance found are cut in four.
    """
    done, closed = 0, 0.0
    known = np.empty(0), np.empty(0, dtype=np.int64)
    while True:
        centre = triangles.mean(axis=1)
        asked = target.closest(centre[: len(centre) - len(known[0])])
        found, face = (np.concatenate(pair) for pair in zip(asked[:2], known, strict=True))
        largest = max(largest, found.max(initial=0.0))
        enough = max(largest * (1 + RELATIVE_GAP), largest + ABSOLUTE_GAP)
        # The distance changes by no more than one moves.
        offset = triangles - centre[:, None]
        radius = np.sqrt(_dot(offset, offset).max(axis=1, initial=0.0))
        bound = found + radius
        for better in (_bound_by_face, _bound_by_pair):
            left = np.flatnonzero(bound > enough)
            bound[left] = np.minimum(bound[left], better(triangles[left], target, face[left]))
        left = bound > enough
        closed = max(closed, bound[~left].max(initial=0.0))
        done += len(triangles)
        if not left.any() or done + 4 * left.sum() > work:
            return largest, max(largest, closed, bound.max(initial=0.0))
        triangles = _quarter(triangles[left])
        known = found[left], face[left]  # a triangle's centre is that of its middle quarter


def _bound_by_face(triangles: np.ndarray, target: Surface, face: np.ndarray) -> np.ndarray:
    """Upper bound (k,) of the distance from triangles (k, 3, 3) to the given face of the target: the distance
    to a convex set is convex, so over a triangle it is largest at a corner."""
    return point_triangle_distance(triangles, target.vertices[target.faces[face]]).max(axis=1, initial=0.0)


def _bound_by_pair(triangles: np.ndarray, target: Surface, face: np.ndarray) -> np.ndarray:
    """Upper bound (k,) of the distance from triangles (k, 3, 3) to the given face of the target and a
    neighbour.

    No point of the convex hull of two faces abc and bad is farther from them than the segments ab and cd are
    from each other: seen along the shortest line between the two, the faces cover the hull, a tetrahedron,
    and that line is the longest way through it. To the hull the distance is convex.
    """
    row = np.arange(len(face))
    corners = target.vertices[target.faces[face]]
    own = point_triangle_distance(triangles, corners)
    side = _most_outside(triangles[row, own.argmax(axis=1)], corners)
    neighbour = target.neighbours[face, side]
    across = point_triangle_distance(triangles, target.vertices[target.faces[neighbour]])
    a, b, c = (corners[row, (side + i) % 3] for i in range(3))
    d = target.vertices[target.faces[neighbour, target.opposite[face, side]]]
    bound = np.minimum(own, across).max(axis=1, initial=0.0) + segment_distance(a, b, c, d)
    return np.where(neighbour >= 0, bound, np.inf)


def _most_outside(points, triangles):
    """The side (k,), from corner i to corner i + 1, beyond which each point lies farthest."""
    side = np.roll(triangles, -1, axis=1) - triangles
    outward = _cross(side, _cross(side[:, 0], side[:, 1])[:, None])
    height = _dot(points[:, None] - triangles, outward)
    return (height / np.maximum(np.sqrt(_dot(outward, outward)), 1e-300)).argmax(axis=1)


def _quarter(triangles):
    """The quarters (4 k, 3, 3) of triangles (k, 3, 3); the last k are the middle ones."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    quarters = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.concatenate([np.stack(quarter, axis=1) for quarter in quarters])


def point_triangle_distance(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Distance (k, p) of points (k, p, 3) to the triangle (k, 3, 3) of the same row."""
    a, b, c = (triangles[:, None, i] for i in range(3))
    normal = _cross(b - a, c - a)
    squared = np.full(points.shape[:2], np.inf)
    inside = np.ones(points.shape[:2], dtype=bool)
    for start, end in ((a, b), (b, c), (c, a)):
        side, to = end - start, points - start
        along = _dot(to, side) / np.maximum(_dot(side, side), 1e-300)
        offset = to - np.clip(along, 0, 1)[:, :, None] * side
        squared = np.minimum(squared, _dot(offset, offset))
        inside &= _dot(to, _cross(normal, side)) >= 0
    length = _dot(normal, normal)
    plane = _dot(points - a, normal) ** 2 / np.maximum(length, 1e-300)
    return np.sqrt(np.where(inside & (length > 0), np.minimum(plane, squared), squared))


def _dot(u, v):
    return u[..., 0] * v[..., 0] + u[..., 1] * v[..., 1] + u[..., 2] * v[..., 2]


def _cross(u, v):
    """As `np.cross`, which takes several times as long."""
    x, y, z = u[..., 0], u[..., 1], u[..., 2]
    p, q, r = v[..., 0], v[..., 1], v[..., 2]
    return np.stack([y * r - z * q, z * p - x * r, x * q - y * p], axis=-1)


def segment_distance(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Distance (k,) between the segments ab and cd; all arguments (k, 3)."""
    ends = [
        _point_segment(a, c, d),
        _point_segment(b, c, d),
        _point_segment(c, a, b),
        _point_segment(d, a, b),
    ]
    u, v, w = b - a, d - c, c - a
    normal = _cross(u, v)
    length = np.maximum(_dot(normal, normal), 1e-300)
    s = _dot(_cross(w, v), normal) / length
    t = _dot(_cross(w, u), normal) / length
    crossing = (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1) & (length > 1e-300)
    between = np.abs(_dot(w, normal)) / np.sqrt(length)
    return np.where(crossing, between, np.min(ends, axis=0))


def _point_segment(point, start, end):
    side, to = end - start, point - start
    along = np.clip(_dot(to, side) / np.maximum(_dot(side, side), 1e-300), 0, 1)
    offset = to - along[:, None] * side
    return np.sqrt(_dot(offset, offset))
