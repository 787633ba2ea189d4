"""Quadric edge collapse (Garland and Heckbert 1997) with pymeshlab."""

import numpy as np
import pymeshlab

from palpate.mesh import topology

# An open mesh that keeps more than this many times the faces asked for is tried again with borders that may
# move.
EXCESS = 1.1

# The quadrics of a border's edges weigh this much more than those of faces, where borders may move.
BORDER_WEIGHT = 10.0


def decimate(vertices: np.ndarray, faces: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (m, 3), rounded to float32, and faces (k, 3) of the mesh with about `count` faces.

    A mesh that has no more than `count` faces comes back as it is. A closed mesh stays closed, and the pieces
    of any mesh stay apart and keep their holes, if need be with more faces than asked for. Borders stay where
    they are, unless that keeps too many faces.
    """
    if len(faces) <= count:
        return vertices, faces
    closed = topology.is_closed(faces)
    level = _collapse(vertices, faces, count, fixed_borders=True)
    if not closed and len(level[1]) > EXCESS * count:
        level = min(
            level, _collapse(vertices, faces, count, fixed_borders=False), key=lambda each: len(each[1])
        )
    if not len(level[1]) or (closed and not topology.is_closed(level[1])):
        return vertices, faces
    return level


def _collapse(vertices, faces, count, fixed_borders):
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(vertices, faces))
    meshes.meshing_decimation_quadric_edge_collapse(
        targetfacenum=count,
        preserveboundary=fixed_borders,
        boundaryweight=BORDER_WEIGHT,
        preservenormal=True,
        preservetopology=True,
        optimalplacement=True,
        planarquadric=True,
        autoclean=False,  # it would drop what collapsed to nothing, and so open closed meshes
    )
    meshes.meshing_remove_unreferenced_vertices()
    mesh = meshes.current_mesh()
    placed = mesh.vertex_matrix().astype(np.float32).astype(np.float64)
    return placed, mesh.face_matrix().astype(np.int64)
