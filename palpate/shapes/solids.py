"""Closed solids that the CAD families are built of: lathed, lofted and swept, combined by manifold3d. Metres. Every
function returns a `manifold3d.Manifold`: a closed, outward-facing solid of positive volume."""

import math
from collections.abc import Iterable, Sequence

import numpy as np
from manifold3d import CrossSection, Manifold, Mesh64, OpType, triangulate
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

# NumPy's `**`, tangent and inverse functions round otherwise where the processor has AVX-512, and a union may order its
# triangles by the last bit. `math` and `np.float_power` call the C library: objects have the same bytes on either.
arctan2 = np.vectorize(math.atan2, otypes=[float])

# Least angle between neighbouring points of an arc, radians, and how far a chord may leave it (m): small arcs have few.
ARC_STEP, ARC_ERROR = np.radians(7.5), 3e-5


def arc_points(turn: float, radius: float) -> int:
    """The points of an arc that turns by an angle (radians)."""
    return max(3, int(np.ceil(turn / max(ARC_STEP, 2 * math.acos(max(1 - ARC_ERROR / radius, 0.6))))) + 1)


def filleted(points: ArrayLike, radii: ArrayLike, closed: bool = False) -> np.ndarray:
    """A polyline (n, 2) or (n, 3) with its corners rounded by tangent arcs of radii (k,), or one; 0 keeps a corner.
    The ends of an open one stay. Where an arc does not fit, it takes up to 49 % of the shorter neighbouring segment."""
    points = np.asarray(points, dtype=float)
    radii = np.broadcast_to(np.asarray(radii, dtype=float), len(points))
    result = []
    for i, (corner, radius) in enumerate(zip(points, radii, strict=True)):
        if radius <= 0 or (not closed and i in (0, len(points) - 1)):
            result.append(corner[None])
            continue
        before, after = points[i - 1] - corner, points[(i + 1) % len(points)] - corner
        long_before, long_after = np.linalg.norm(before), np.linalg.norm(after)
        before, after = before / long_before, after / long_after
        half = math.acos(np.clip(before @ after, -1, 1)) / 2
        turn = np.pi - 2 * half
        if turn < 1e-3 or half < 1e-3:
            result.append(corner[None])
            continue
        tangent = min(radius / math.tan(half), 0.49 * min(long_before, long_after))
        radius = tangent * math.tan(half)
        bisector = before + after
        bisector /= np.linalg.norm(bisector)
        centre = corner + bisector * radius / np.sin(half)
        start = (corner + tangent * before - centre) / radius
        end = (corner + tangent * after - centre) / radius
        t = np.linspace(0, 1, arc_points(turn, radius))[:, None]
        # Spherical interpolation between the two radii of the arc.
        result.append(centre + radius * (np.sin((1 - t) * turn) * start + np.sin(t * turn) * end) / np.sin(turn))
    return np.concatenate(result)


def lathe(profile: ArrayLike, segments: int = 64) -> Manifold:
    """Revolve a profile around z: (k, 2) rows of (radius, z), a simple polyline whose ends are joined to the axis."""
    profile = np.asarray(profile, dtype=float)
    outline = np.concatenate([[[0.0, profile[0, 1]]], profile, [[0.0, profile[-1, 1]]]])
    keep = np.append(True, np.linalg.norm(np.diff(outline, axis=0), axis=1) > 1e-9)
    return Manifold.revolve(CrossSection([counter_clockwise(outline[keep])]), segments)


def counter_clockwise(polygon: np.ndarray) -> np.ndarray:
    """The polygon (k, 2), reversed if it runs clockwise."""
    x, y = polygon.T
    area = np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)
    return polygon if area > 0 else polygon[::-1]


def loft(rings: np.ndarray) -> Manifold:
    """Skin over k closed rings (k, m, 3) of m points each, corresponding points joined; the first and the last are
    closed by a fan around their mean. Raises ValueError where this is not a closed solid."""
    count, around, _ = rings.shape
    here, there = np.arange(around), np.roll(np.arange(around), -1)
    vertices = np.concatenate([rings.reshape(-1, 3), [rings[0].mean(0), rings[-1].mean(0)]])
    bottom = np.stack([here, there, np.full(around, count * around)], axis=1)
    top = np.stack([there, here, np.full(around, count * around + 1)], axis=1)
    top[:, :2] += (count - 1) * around
    return closed(vertices, np.concatenate([wall(count, around), bottom, top]))


def wall(count: int, around: int) -> np.ndarray:
    """Faces between `count` rings of `around` vertices each, numbered ring by ring."""
    index = np.arange(count * around).reshape(count, around)
    (a, c), (b, d) = ((each[:-1], each[1:]) for each in (index, np.roll(index, -1, axis=1)))
    return np.concatenate([np.stack([b, a, d], -1).reshape(-1, 3), np.stack([d, a, c], -1).reshape(-1, 3)])


def closed(vertices: np.ndarray, faces: np.ndarray) -> Manifold:
    """The solid within consistently wound faces, turned outward if need be. Raises ValueError if there is none."""
    corners = vertices[faces]
    volume = np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    solid = Manifold(Mesh64(vertices, (faces if volume > 0 else faces[:, ::-1]).astype(np.uint64)))
    if solid.is_empty():
        raise ValueError(f"these cross-sections do not make a closed solid: {solid.status()}")
    return solid


def superellipse(width: float, height: float, exponent: float = 2.0, count: int = 40) -> np.ndarray:
    """(count, 2) points of |2x/width|^n + |2y/height|^n = 1: an ellipse at n = 2, nearly a box at n = 8."""
    angle = 2 * np.pi * (np.arange(count) + 0.5) / count
    cosine, sine = np.cos(angle), np.sin(angle)
    # The radial form spaces points evenly in angle; the usual power form crowds them at the corners.
    sums = np.float_power(np.abs(cosine), exponent) + np.float_power(np.abs(sine), exponent)
    radius = np.float_power(sums, -1 / exponent)
    return np.stack([width / 2 * radius * cosine, height / 2 * radius * sine], axis=1)


def slab(
    size: tuple[float, float, float], corner: float, fillet: float, centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> Manifold:
    """A plate standing in the y-z plane: size = (thickness along x, width along y, height along z); corner: radius of
    its outline, at least `fillet`, that of the rim around front and back."""
    thickness, width, height = size
    fillet = min(fillet, 0.499 * thickness, 0.4 * min(width, height))
    corners = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * [width / 2, height / 2]
    return prism(filleted(corners, max(corner, 1.1 * fillet), closed=True), thickness, fillet).translate(centre)


def prism(outline: ArrayLike, thickness: float, edge: float = 0.0) -> Manifold:
    """A plate in the y-z plane, centred on x = 0. outline: (k, 2) rows of (y, z); edge: radius that rounds the rim of
    both faces, smaller than the outline's convex radii and half its narrowest place."""
    outline = counter_clockwise(np.asarray(outline, dtype=float))
    edge = min(edge, 0.499 * thickness)
    angle = np.linspace(0, np.pi / 2, arc_points(np.pi / 2, edge)) if edge > 0 else np.array([np.pi / 2])
    inset, x = edge * (1 - np.sin(angle)), edge * (1 - np.cos(angle)) - thickness / 2
    inset, x = np.append(inset, inset[::-1]), np.append(x, -x[::-1])
    edges = np.roll(outline, -1, axis=0) - outline
    normal = np.stack([-edges[:, 1], edges[:, 0]], axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    mean = normal + np.roll(normal, 1, axis=0)
    # |mean|^2 = 4 cos^2(half the turn); a mitre is 1 / cos, limited to 2 at spikes.
    inwards = 2 * mean / np.maximum((mean**2).sum(axis=1, keepdims=True), 1.0)
    planes = outline + inset[:, None, None] * inwards
    depth = np.broadcast_to(x[:, None, None], (*planes.shape[:2], 1))
    rings = np.concatenate([depth, planes], axis=2)
    cap = np.asarray(triangulate([planes[0]]))
    faces = [wall(len(x), len(outline)), cap, cap[:, ::-1] + (len(x) - 1) * len(outline)]
    return closed(rings.reshape(-1, 3), np.concatenate(faces))


def bent_bar(path: ArrayLike, fillet: float, width: float, height: float, exponent: float, count: int) -> Manifold:
    """A bar along a polyline (k, 3) with rounded corners; its section is a superellipse, `width` along x."""
    return sweep(filleted(path, fillet), superellipse(width, height, exponent, count))


def sweep(path: ArrayLike, section: np.ndarray, scale: ArrayLike = 1.0, side: ArrayLike = (1.0, 0.0, 0.0)) -> Manifold:
    """Move a section (m, 2) along a path (k, 3), its first coordinate along `side`; scale: one, or (k, 2)."""
    path = np.asarray(path, dtype=float)
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    across = np.cross(tangent, np.asarray(side))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    first = np.cross(across, tangent)
    flat = section * np.atleast_2d(scale)[:, None]  # (k, m, 2), or (1, m, 2)
    return loft(path[:, None] + first[:, None] * flat[..., :1] + across[:, None] * flat[..., 1:])


def along_y(stations: ArrayLike, exponent: float = 2.6, rings: int = 60, count: int = 40) -> Manifold:
    """A body along y, through stations (k, 4) of (y, lowest z, highest z, width), of superellipses."""
    stations = np.asarray(stations, dtype=float)
    y = np.linspace(stations[0, 0], stations[-1, 0], rings)
    low, high, width = PchipInterpolator(stations[:, 0], stations[:, 1:])(y).T
    unit = superellipse(1, 1, exponent, count)
    x = width[:, None] * unit[:, 0]
    z = (high + low)[:, None] / 2 + (high - low)[:, None] * unit[:, 1]
    return loft(np.stack([x, np.broadcast_to(y[:, None], x.shape), z], axis=-1))


def upright(profile: ArrayLike, section: np.ndarray) -> Manifold:
    """A body along z. profile: (k, 2) rows of (radius, z); section: (m, 2) or (k, m, 2), for radius 1."""
    profile = np.asarray(profile, dtype=float)
    flat = section * profile[:, :1, None]  # (k, m, 2)
    return loft(np.concatenate([flat, np.broadcast_to(profile[:, 1:, None], (*flat.shape[:2], 1))], axis=2))


def fluted(depth: ArrayLike, flutes: int, count: int) -> np.ndarray:
    """(..., count, 2) unit circles with `flutes` grooves of relative `depth` (...): knurls, ribs, crown caps."""
    angle = 2 * np.pi * np.arange(count) / count
    radius = 1 - np.asarray(depth)[..., None] * (0.5 - 0.5 * np.cos(flutes * angle))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)


def rod(start: ArrayLike, end: ArrayLike, radius: float, segments: int = 32) -> Manifold:
    """A cylinder from `start` to `end` (3,)."""
    axis = np.subtract(end, start) / np.linalg.norm(np.subtract(end, start))
    side = np.eye(3)[np.argmin(np.abs(axis))]
    return sweep(np.array([start, end]), superellipse(2, 2, 2, segments), radius, side)


def turned(profile: ArrayLike, start: ArrayLike, direction: ArrayLike, segments: int = 32) -> Manifold:
    """A lathed solid, its axis from `start` along `direction`; profile as in `lathe`, z along the axis."""
    axis = np.asarray(direction, float) / np.linalg.norm(direction)
    first = np.cross(np.eye(3)[np.argmin(np.abs(axis))], axis)
    first /= np.linalg.norm(first)
    frame = np.column_stack([first, np.cross(axis, first), axis, np.asarray(start, float)])
    return lathe(profile, segments).transform(frame)


def box(size: Sequence[float], centre: Sequence[float] = (0.0, 0.0, 0.0)) -> Manifold:
    """An axis-aligned box: its lengths (3,) and its centre (3,)."""
    return Manifold.cube(tuple(map(float, size)), True).translate(tuple(map(float, centre)))


def union(solids: Iterable[Manifold]) -> Manifold:
    """The union of solids."""
    return Manifold.batch_boolean(list(solids), OpType.Add)


def cut(solid: Manifold, tools: Iterable[Manifold]) -> Manifold:
    """`solid` without all of the `tools`."""
    return Manifold.batch_boolean([solid, *tools], OpType.Subtract)
