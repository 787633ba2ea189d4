"""Polygons of any number of corners, concave or with holes, strips and fans as triangles."""

from collections.abc import Sequence

import manifold3d
import numpy as np
from numpy.typing import ArrayLike

FLAT = 1e-9  # of the square of a polygon's longest spoke: twice the area of a triangle that counts as flat
MOST_STARTS = 16  # corners of which a fan is tried: quicker than by ears


def triangulate(vertices: np.ndarray, corners: np.ndarray, counts: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Triangles of polygons without holes, in their order, as (t, 3) places in `corners`, and the polygon (t,) of each;
    none of fewer than three corners. corners: numbers of vertices (n, 3), polygon by polygon; counts (p,): corners of
    each. One is a fan from its first corner that sees all others; else ears are cut. What is closed stays closed."""
    counts = np.asarray(counts, dtype=np.int64)
    first = np.cumsum(counts) - counts
    made, owners = [np.zeros((0, 3), np.int64)], [np.zeros(0, np.int64)]
    for count in np.unique(counts[counts >= 3]):
        index = np.flatnonzero(counts == count)
        fan = np.stack([np.zeros(count - 2, np.int64), np.arange(1, count - 1), np.arange(2, count)], axis=1)
        for start in range(min(count, MOST_STARTS) if count > 3 else 1):
            place = first[index, None] + np.roll(np.arange(count), -start)  # (k, count)
            sees = np.ones(len(index), bool) if count == 3 else _is_fan(vertices[corners[place]])
            made.append(place[sees][:, fan].reshape(-1, 3))
            owners.append(np.repeat(index[sees], count - 2))
            index = index[~sees]
        place = first[index, None] + np.arange(count)
        for polygon, at, flat in zip(index, place, _flat(vertices[corners[place]]), strict=True):
            made.append(at[np.asarray(manifold3d.triangulate([flat]), dtype=np.int64)])
            owners.append(np.full(len(made[-1]), polygon))
    triangles, owner = np.concatenate(made), np.concatenate(owners)
    order = np.argsort(owner, kind="stable")
    return triangles[order], owner[order]


def with_holes(rings: Sequence[np.ndarray]) -> np.ndarray:
    """Triangles (t, 3) of one polygon: its outline (n, 3), then its holes (m, 3), wound either way. They are numbers
    in all rings' corners together, and wound as the outline; each corner is one of some triangle."""
    count = len(rings[0])
    flat = _flat(np.concatenate(rings)[None], count)[0]
    numbers = np.split(np.arange(len(flat)), np.cumsum([len(ring) for ring in rings])[:-1])
    for k, ring in enumerate(numbers[1:], 1):
        (x, y), (next_x, next_y) = flat[ring].T, np.roll(flat[ring], -1, axis=0).T
        numbers[k] = ring[::-1] if (x * next_y - next_x * y).sum() > 0 else ring  # it runs counter-clockwise
    made = manifold3d.triangulate([flat[ring] for ring in numbers])
    return np.concatenate(numbers)[np.asarray(made, dtype=np.int64).reshape(-1, 3)]


def strip_triangles(corners: np.ndarray, counts: ArrayLike, fan: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Triangles of strips or fans, as of `triangulate`: places (t, 3) in `corners`, and the strip (t,) of each. A
    corner -1 ends a strip. Triangles that name a vertex twice only join strips: they are left out."""
    corners, counts = np.asarray(corners, dtype=np.int64), np.asarray(counts, dtype=np.int64)
    owner = np.repeat(np.arange(len(counts)), counts)
    place, begins = np.arange(len(corners)), np.diff(owner, prepend=-1) > 0
    begins[1:] |= corners[:-1] == -1
    first = np.maximum.accumulate(np.where(begins, place, 0))
    triangles = place[:-2, None] + np.arange(3)
    if fan:
        triangles[:, 0] = first[:-2]
    else:  # every second one is wound the other way
        triangles = np.where((place - first)[:-2, None] % 2, triangles[:, [1, 0, 2]], triangles)
    a, b, c = corners[triangles].T
    good = (first[:-2] == first[2:]) & (c != -1) & (a != b) & (b != c) & (c != a)
    return triangles[good], owner[:-2][good]


@np.errstate(invalid="ignore", over="ignore")  # vertices that are not finite are looked for later
def _is_fan(polygons: np.ndarray) -> np.ndarray:
    """Which polygons (p, c, 3) are a fan of triangles from their first corner that nowhere folds back, (p,) bool."""
    spoke = polygons[:, 1:] - polygons[:, :1]
    cross = np.cross(spoke[:, :-1], spoke[:, 1:])
    area = np.einsum("pcx,px->pc", cross, _normal(polygons))
    bend = np.einsum("pcx,pcx->pc", cross[:, :-1], cross[:, 1:])  # as Blender cuts quads that are not flat
    return (area > FLAT * np.square(spoke).sum(axis=2).max(axis=1)[:, None]).all(axis=1) & (bend > 0).all(axis=1)


@np.errstate(invalid="ignore", over="ignore")
def _flat(polygons: np.ndarray, count: int | None = None) -> np.ndarray:
    """Polygons (p, c, 3) in their planes (p, c, 2), counter-clockwise, of size 1; of `count` corners of an outline."""
    outline = polygons[:, :count]
    normal = _normal(outline)
    across = np.cross(normal, np.eye(3)[np.abs(normal).argmin(axis=1)])
    across /= np.maximum(np.linalg.norm(across, axis=1), 1e-300)[:, None]
    axes = np.stack([across, np.cross(normal, across)], axis=2)  # (p, 3, 2)
    size = np.abs(outline - outline[:, :1]).max(axis=(1, 2), initial=1e-300)
    return (polygons - outline[:, :1]) @ axes / size[:, None, None]


def _normal(polygons: np.ndarray) -> np.ndarray:
    """Unit normals (p, 3) of polygons (p, c, 3), by Newell's method; 0 of those without an area."""
    corner = polygons - polygons[:, :1]
    corner = corner / np.maximum(np.abs(corner).max(axis=(1, 2), initial=0), 1e-300)[:, None, None]
    normal = np.cross(corner, np.roll(corner, -1, axis=1)).sum(axis=1)
    return normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
