"""Quadric edge collapse (Garland and Heckbert 1997) with pymeshlab."""

import numpy as np
import pymeshlab

from palpate.mesh import MAX_DEVIATION, topology
from palpate.mesh.distance import Surface, hausdorff

EXCESS = 1.1  # an open mesh with more than this many times the faces asked for is tried again with movable borders
# Just enough for compact triangles in planes, where every collapse costs the same. pymeshlab's 0.001 bends edges: at
# 1,000 faces a knife is 3.5 mm off with it and 0.2 mm without.
PLANAR_WEIGHT = 1e-6
QUALITY = 0.3  # shapes of triangles no worse than this (1 for equilateral) count as equally good: pymeshlab's default


def decimate(vertices: np.ndarray, faces: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (m, 3), rounded to float32, and faces (k, 3) of the mesh with about `count` faces; of fewer as it is. A
    closed mesh stays closed, and the pieces of any mesh stay apart and keep their holes, if need be with more faces.
    Borders stay where they are, unless that keeps too many faces. Where the surface moves by more than `MAX_DEVIATION`,
    it keeps twice as many faces, and so on: where many faces share an edge, the collapse leaves spikes and holes (4,000
    faces of a vase of half a metre reached 9 m out)."""
    while len(faces) > count:
        level = collapsed(vertices, faces, count)
        if len(level[1]) and hausdorff(Surface(vertices, faces), Surface(*level)) <= MAX_DEVIATION:
            return level
        count = 2 * max(count, len(level[1]))  # asked for fewer than are left, it would leave as many again
    return vertices, faces


def collapsed(vertices: np.ndarray, faces: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """As `decimate`, however far the surface moves."""
    if len(faces) <= count:
        return vertices, faces
    closed = topology.is_closed(faces)
    level = _collapsed(vertices, faces, count, True)
    if not closed and len(level[1]) > EXCESS * count:
        looser = _collapsed(vertices, faces, count, False)
        level = min(level, looser, key=lambda mesh: len(mesh[1]))
    return (vertices, faces) if closed and not topology.is_closed(level[1]) else level


def _collapsed(
    vertices: np.ndarray, faces: np.ndarray, count: int, fixed_borders: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces after quadric edge collapse to about `count` faces."""
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(vertices, faces))
    # All parameters: those not given pymeshlab takes from the call before, and results would depend on it.
    # Cleaning would drop what collapsed to nothing, and so open closed meshes.
    meshes.meshing_decimation_quadric_edge_collapse(
        **{"targetfacenum": count, "targetperc": 0.0, "qualitythr": QUALITY, "optimalplacement": True},
        **{"preserveboundary": fixed_borders, "boundaryweight": 10.0, "preservenormal": True},
        **{"planarquadric": True, "planarweight": PLANAR_WEIGHT, "preservetopology": True},
        **{"qualityweight": False, "autoclean": False, "selected": False},
    )
    meshes.meshing_remove_unreferenced_vertices()
    mesh = meshes.current_mesh()
    placed = mesh.vertex_matrix().astype(np.float32).astype(np.float64)
    return placed, mesh.face_matrix().astype(np.int64)
