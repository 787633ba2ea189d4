"""An object's surface as many small convex pieces, which stop a finger at the true surface. Each patch is the hull of
one surface piece of about a cell, thickened inwards a little. A convex hull of the object, or of its parts, would fill
its hollows. A convex decomposition needs a watertight mesh and seconds."""

import numpy as np
import trimesh

CELL = 0.025  # metres
THICKNESS = 0.001  # metres
WELD = 1e-6  # metres: vertices of a patch this close are one
NARROWEST = 2e-5  # metres: narrower patches are skipped, for their hulls are degenerate


def surface_patches(mesh: trimesh.Trimesh, cell: float = CELL) -> list[np.ndarray]:
    """Point sets (V, 3) whose convex hulls together are a thin shell on the inner side of the mesh's surface.
    Triangles, cut to edges of at most half a cell, are grouped by the grid cell of their centre and the signed axis
    nearest to their normal; a group's vertices and a copy shifted inwards by `THICKNESS` are a patch. Faces without
    area are omitted, and groups narrower than `NARROWEST`."""
    triangles = split_long_edges(np.asarray(mesh.triangles), cell / 2)
    areas = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]) / 2  # along the normals
    has_area = areas.any(axis=1)
    triangles, areas = triangles[has_area], areas[has_area]
    if not len(triangles):
        return []
    axis = np.abs(areas).argmax(axis=1)
    side = areas[np.arange(len(areas)), axis] > 0
    cells = np.floor(triangles.mean(axis=1) / cell).astype(np.int64)
    cells -= cells.min(axis=0)
    number = np.ravel_multi_index((*cells.T, axis, side.astype(int)), (*(cells.max(axis=0) + 1), 3, 2))
    group = np.unique(number, return_inverse=True)[1].ravel()
    longest = np.zeros(group.max() + 1)
    np.maximum.at(longest, group, edge_lengths(triangles).T.copy().max(axis=0))
    wide = (np.bincount(group, weights=np.linalg.norm(areas, axis=1)) >= NARROWEST * longest)[group]
    if not wide.any():
        return []
    triangles, areas, group = triangles[wide], areas[wide], np.unique(group[wide], return_inverse=True)[1].ravel()

    # The corners of each group's triangles, each once, by ascending group. Two numbers a corner in place of four: half
    # the sorting, and both are far below 2^63 for metres.
    points, owner = triangles.reshape(-1, 3), np.repeat(group, 3)
    x, y, z = np.round(points / WELD).astype(np.int64).T.copy()
    x, z = x - x.min(), z - z.min()
    column, row = y * (x.max() + 1) + x, owner * (z.max() + 1) + z
    order = np.lexsort((column, row))
    fresh = np.concatenate([[True], (np.diff(column[order]) != 0) | (np.diff(row[order]) != 0)])
    points, owner = points[order[fresh]], owner[order[fresh]]
    # The mean over the area: many small triangles on an edge don't turn it.
    outwards = np.column_stack([np.bincount(group, weights=areas[:, axis]) for axis in range(3)])
    outwards = outwards / np.linalg.norm(outwards, axis=1, keepdims=True)
    bounds = np.flatnonzero(np.diff(owner)) + 1
    outer, inner = np.split(points, bounds), np.split(points - THICKNESS * outwards[owner], bounds)
    return [np.concatenate(pair) for pair in zip(outer, inner, strict=True)]


def edge_lengths(triangles: np.ndarray) -> np.ndarray:
    """Lengths (T, 3) of the edges of triangles (T, 3, 3); edge i goes from corner i to the next."""
    return lengths(np.roll(triangles, -1, axis=1) - triangles)


def lengths(vectors: np.ndarray) -> np.ndarray:
    """Lengths (...) of vectors (..., 3), the same as numpy's `norm`, whose sums along short axes are slow."""
    squares = vectors * vectors
    return np.sqrt(squares[..., 0] + squares[..., 1] + squares[..., 2])


def halved(triangles: np.ndarray) -> np.ndarray:
    """Triangles (T, 3, 3) cut in two at the middle of their longest edges: (2 T, 3, 3), winding kept."""
    at, rows = edge_lengths(triangles).argmax(axis=1), np.arange(len(triangles))
    start, end, tip = (triangles[rows, (at + shift) % 3] for shift in range(3))
    middle = (start + end) / 2
    return np.concatenate([np.stack([start, middle, tip], axis=1), np.stack([middle, end, tip], axis=1)])


def split_long_edges(triangles: np.ndarray, longest: float) -> np.ndarray:
    """Triangles (S, 3, 3): (T, 3, 3) halved until no edge exceeds `longest`; neighbours need not share vertices."""
    done = []
    while len(triangles):
        fits = edge_lengths(triangles).T.copy().max(axis=0) <= longest
        done.append(triangles[fits])
        triangles = halved(triangles[~fits])
    return np.concatenate(done) if done else triangles
