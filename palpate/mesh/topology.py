"""Topology of a mesh: edges, shells, closed or open, winding."""

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components


def cross(triangles: np.ndarray) -> np.ndarray:
    """Normals (f, 3) of triangles (f, 3, 3), twice as long as their area."""
    return np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])


def edge_keys(faces: np.ndarray, directed: bool = False) -> np.ndarray:
    """One int64 for each edge (3 f,), equal for equal edges: a number is faster to sort than a pair. Number 3 i + k is
    of face i."""
    pairs = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    if not directed:
        pairs = np.sort(pairs, axis=1)
    return pairs[:, 0] << 32 | pairs[:, 1]


def edge_counts(faces: np.ndarray, group: np.ndarray | None = None) -> np.ndarray:
    """How many faces (of the face's own group, if groups (f,) are given) share each edge (3 f,)."""
    keys = edge_keys(faces)
    if group is not None:
        _, keys = np.unique(keys, return_inverse=True)
        keys = keys.astype(np.int64) * (int(group.max(initial=0)) + 1) + np.repeat(group, 3)
    _, inverse, counts = np.unique(keys, return_inverse=True, return_counts=True)
    return counts[inverse]


def shells(faces: np.ndarray, vertex_count: int) -> np.ndarray:
    """The number of the connected component (by shared vertices) of each face (f,), counted from 0."""
    ones = np.ones(2 * len(faces), dtype=bool)
    graph = coo_matrix((ones, (np.tile(faces[:, 0], 2), faces[:, 1:].T.ravel())), shape=(vertex_count, vertex_count))
    _, label = connected_components(graph, directed=False)
    return np.unique(label[faces[:, 0]], return_inverse=True)[1]


def closed_groups(faces: np.ndarray, group: np.ndarray) -> np.ndarray:
    """Which groups (g,) bool of faces are closed: each edge of the group has exactly two of its faces."""
    two = (edge_counts(faces, group) == 2).reshape(-1, 3).all(axis=1)
    return np.bincount(group, weights=~two, minlength=group.max(initial=-1) + 1) == 0


def is_closed(faces: np.ndarray) -> bool:
    """Whether each edge has exactly two faces, which run through it in opposite directions."""
    directed = np.sort(edge_keys(faces, directed=True))
    reverse = np.sort(edge_keys(faces[:, ::-1], directed=True))
    loops = faces == np.roll(faces, 1, axis=1)
    return bool(
        len(faces) and not loops.any() and np.array_equal(directed, reverse) and (directed[1:] != directed[:-1]).all()
    )
