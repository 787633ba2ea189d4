"""Topology of a mesh: edges, shells, closed or open, winding."""

import numpy as np
from trimesh.geometry import faces_to_edges
from trimesh.graph import connected_component_labels, is_watertight

from palpate.mesh.part import distinct


def cross(triangles: np.ndarray) -> np.ndarray:
    """Normals (f, 3) of triangles (f, 3, 3), twice as long as their area."""
    return np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])


def edge_counts(faces: np.ndarray, group: np.ndarray | int = 0) -> np.ndarray:
    """How many faces (of the face's own group, if groups (f,) are given) share each edge (3 f,): number 3 i + k is of
    face i."""
    low, high = np.sort(faces_to_edges(faces), axis=1).T
    # One number for both ends is faster to sort than a pair.
    _, number = distinct(low << 32 | high, np.repeat(np.broadcast_to(group, len(faces)), 3))
    return np.bincount(number)[number]


def shells(faces: np.ndarray, vertex_count: int) -> np.ndarray:
    """The number of the connected component (by shared vertices) of each face (f,), counted from 0."""
    label = connected_component_labels(faces[:, [0, 1, 1, 2]].reshape(-1, 2), vertex_count)
    return np.unique(label[faces[:, 0]], return_inverse=True)[1]


def closed_groups(faces: np.ndarray, group: np.ndarray) -> np.ndarray:
    """Which groups (g,) bool of faces are closed: each edge of the group has exactly two of its faces."""
    two = (edge_counts(faces, group) == 2).reshape(-1, 3).all(axis=1)
    return np.bincount(group, weights=~two, minlength=group.max(initial=-1) + 1) == 0


def is_closed(faces: np.ndarray) -> bool:
    """Whether each edge has exactly two faces, which run through it in opposite directions."""
    loops = (faces == np.roll(faces, 1, axis=1)).any()
    return len(faces) > 0 and not loops and all(is_watertight(faces_to_edges(faces)))
