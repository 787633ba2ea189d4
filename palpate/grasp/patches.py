"""An object's surface as many small convex pieces, which stop a finger at the true surface.

A convex hull of the object (or of parts of it) fills its hollows, and a convex decomposition needs a
watertight mesh and seconds. Patches need neither: each is the hull of one surface piece of about a cell, a
little thickened inwards.
"""

import numpy as np
import trimesh

from palpate.grasp.triangles import split_long_edges

CELL = 0.025  # metres
THICKNESS = 0.001  # metres
WELD = 1e-6  # metres: vertices of a patch this close are one


def surface_patches(
    mesh: trimesh.Trimesh, cell: float = CELL, thickness: float = THICKNESS
) -> list[np.ndarray]:
    """Point sets (V, 3) whose convex hulls together are a thin shell on the inner side of the mesh's surface.

    Triangles, cut to edges of at most half a cell, are grouped by the grid cell of their centre and the
    signed axis that their normal is nearest to; a group's vertices and a copy shifted inwards by `thickness`
    make a patch.
    """
    triangles = split_long_edges(np.asarray(mesh.triangles), cell / 2)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    length = np.linalg.norm(normals, axis=1)
    triangles, normals, length = triangles[length > 0], normals[length > 0], length[length > 0]
    normals /= length[:, None]
    axis = np.abs(normals).argmax(axis=1)
    side = normals[np.arange(len(normals)), axis] > 0
    cells = np.floor(triangles.mean(axis=1) / cell).astype(np.int64)
    cells -= cells.min(axis=0)
    extent = cells.max(axis=0) + 1
    group = np.ravel_multi_index((*cells.T, axis, side.astype(int)), (*extent, 3, 2))
    _, group = np.unique(group, return_inverse=True)
    group = group.ravel()

    points, owner = triangles.reshape(-1, 3), np.repeat(group, 3)
    keys = np.round(points / WELD).astype(np.int64)
    order = np.lexsort((*keys.T, owner))
    keys, points, owner = keys[order], points[order], owner[order]
    fresh = np.concatenate([[True], (np.diff(owner) != 0) | (np.diff(keys, axis=0) != 0).any(axis=1)])
    points, owner = points[fresh], owner[fresh]

    # By area, so that many small triangles on an edge don't turn the direction.
    mean = np.column_stack([np.bincount(group, weights=(normals * length[:, None])[:, k]) for k in range(3)])
    inwards = -thickness * mean / np.linalg.norm(mean, axis=1, keepdims=True)
    bounds = np.flatnonzero(np.diff(owner)) + 1
    outer, inner = np.split(points, bounds), np.split(points + inwards[owner], bounds)
    return [np.concatenate(pair) for pair in zip(outer, inner, strict=True)]
