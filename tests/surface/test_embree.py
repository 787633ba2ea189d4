"""The normals of the faces that points are on."""

import numpy as np
import trimesh

from palpate.surface.embree import RayMesh


def test_normals_are_those_of_the_faces_under_the_points():
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=0.2)
    points, faces = trimesh.sample.sample_surface(mesh, 500, seed=0)
    expected = mesh.face_normals[faces]
    np.testing.assert_allclose(RayMesh(mesh).normals_at(points), expected, atol=1e-6)
    # A face without an area, though nearest to the points, has no normal.
    needles = mesh.faces[faces[:5]] * [1, 1, 0] + mesh.faces[faces[:5], :1] * [0, 0, 1]
    dirty = trimesh.Trimesh(mesh.vertices, np.concatenate([needles, mesh.faces]), process=False)
    on_edges = mesh.vertices[mesh.faces[faces[:5], :2]].mean(axis=1)
    found = RayMesh(dirty).normals_at(np.concatenate([points, on_edges]))
    np.testing.assert_allclose(found[:500], expected, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1)
