"""How far two surfaces are from each other, measured: mean, largest found, and a bound that holds
everywhere."""

import igl
import numpy as np

from palpate.mesh import topology

SAMPLES = 8_000

# The bound is refined until it is within this share, or within this length (metres), of the largest distance
# found, or until this many triangles have been looked at.
RELATIVE_GAP = 0.1
ABSOLUTE_GAP = 5e-5
WORK = 30_000


class Surface:
    """A triangle mesh prepared for closest-point queries: vertices (n, 3), faces (f, 3)."""

    def __init__(self, vertices: np.ndarray, faces: np.ndarray):
        self.vertices = np.ascontiguousarray(vertices, dtype=np.float64)
        self.faces = np.ascontiguousarray(faces, dtype=np.int64)
        self.neighbours, self.opposite = topology.neighbours(self.faces)
        self.fans = _fans(self.vertices, self.faces, self.neighbours)
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

    Triangles for which no bound shows that they can't beat the largest distance found are cut in four.
    """
    work, closed = 0, 0.0
    known, known_face = np.empty(0), np.empty(0, dtype=np.int64)
    while True:
        centre = triangles.mean(axis=1)
        found, face = target.closest(centre[: len(centre) - len(known)])
        found, face = np.r_[found, known], np.r_[face, known_face]
        largest = max(largest, found.max(initial=0.0))
        enough = max(largest * (1 + RELATIVE_GAP), largest + ABSOLUTE_GAP)
        # The distance changes by no more than one moves.
        offset = triangles - centre[:, None]
        radius = np.sqrt(_dot(offset, offset).max(axis=1, initial=0.0))
        bound = found + radius
        for better in (_bound_by_face, _bound_by_fan, _bound_by_pair):
            left = np.flatnonzero(bound > enough)
            bound[left] = np.minimum(bound[left], better(triangles[left], target, face[left]))
        left = bound > enough
        closed = max(closed, bound[~left].max(initial=0.0))
        work += len(triangles)
        if not left.any() or work + 4 * left.sum() > WORK:
            return largest, max(largest, closed, bound.max(initial=0.0))
        triangles = _quarter(triangles[left])
        known, known_face = found[left], face[left]  # a triangle's centre is that of its middle quarter


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


def _bound_by_fan(triangles: np.ndarray, target: Surface, face: np.ndarray) -> np.ndarray:
    """Upper bound (k,) of the distance from triangles (k, 3, 3) to the faces around a corner of the given
    face.

    Seen along the corner's normal, these faces cover a disc around it (see `_fans`). A triangle over that
    disc has, along the normal, a face above or below each of its points.
    """
    normals, radii, slopes = target.fans
    corners = target.vertices[target.faces[face]]
    offset = corners - triangles.mean(axis=1)[:, None]
    vertex = target.faces[face, _dot(offset, offset).argmin(axis=1)]
    offset = triangles - target.vertices[vertex][:, None]
    normal = normals[vertex][:, None]
    height = _dot(offset, normal)
    beside = offset - height[..., None] * normal
    reach = np.sqrt(_dot(beside, beside).max(axis=1, initial=0.0))
    bound = np.abs(height).max(axis=1, initial=0.0) + slopes[vertex] * reach
    return np.where(reach <= radii[vertex], bound, np.inf)


def _fans(vertices, faces, neighbours):
    """For each vertex: its normal (n, 3); the radius (n,) of the disc around it, perpendicular to the normal,
    that the projection of its faces covers; and their greatest slope (n,) against that disc.

    The radius is 0 where the faces do not go around the vertex once, or one of them is turned away.
    """
    count = len(vertices)
    corner = vertices[faces]
    normal = _cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    sums = [np.bincount(faces.ravel(), np.repeat(normal[:, axis], 3), minlength=count) for axis in range(3)]
    normals = np.stack(sums, axis=1)
    normals /= np.maximum(np.sqrt(_dot(normals, normals)), 1e-300)[:, None]
    normal = normal / np.maximum(np.sqrt(_dot(normal, normal)), 1e-300)[:, None]
    angle, radius, cosine = np.zeros(count), np.full(count, np.inf), np.ones(count)
    for i in range(3):
        at, up = faces[:, i], normals[faces[:, i]]
        sides = [corner[:, (i + j) % 3] - corner[:, i] for j in (1, 2)]
        a, b = (side - _dot(side, up)[:, None] * up for side in sides)
        angle += np.bincount(at, np.arctan2(_dot(up, _cross(a, b)), _dot(a, b)), minlength=count)
        whole = (neighbours[:, i] >= 0) & (neighbours[:, i - 1] >= 0)
        np.minimum.at(radius, at, np.where(whole, _point_segment(np.zeros_like(a), a, b), 0))
        np.minimum.at(cosine, at, _dot(normal, up))
    around = (np.abs(angle - 2 * np.pi) < 1e-6) & (cosine > 0.1)
    cosine = np.clip(cosine, 0.1, 1)
    return normals, np.where(around, radius, 0), np.sqrt(1 - cosine**2) / cosine


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
