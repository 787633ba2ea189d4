"""Quadric edge collapse (Garland and Heckbert 1997) with pymeshlab."""

import numpy as np
import pymeshlab

from palpate.mesh import topology


def decimate(vertices: np.ndarray, faces: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (m, 3), rounded to float32, and faces (k, 3) of the mesh with about `count` faces.

    A mesh that has no more than `count` faces comes back as it is. Borders are preserved; a closed mesh stays
    closed, if need be with more faces than asked for (its topology is never changed to get fewer).
    """
    if len(faces) <= count:
        return vertices, faces
    closed = topology.is_closed(faces)
    level = _collapse(vertices, faces, count)
    if not len(level[1]) or (closed and not topology.is_closed(level[1])):
        return vertices, faces
    return level


def _collapse(vertices, faces, count):
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(vertices, faces))
    meshes.meshing_decimation_quadric_edge_collapse(
        targetfacenum=count,
        preserveboundary=True,
        preservenormal=True,
        preservetopology=True,
        optimalplacement=True,
        planarquadric=True,
        autoclean=False,
    )
    meshes.meshing_remove_unreferenced_vertices()
    mesh = meshes.current_mesh()
    placed = mesh.vertex_matrix().astype(np.float32).astype(np.float64)
    return placed, mesh.face_matrix().astype(np.int64)
