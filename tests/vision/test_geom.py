import numpy as np
import pytest
import trimesh

from palpate.hand.hand import signed_distance
from palpate.vision import geom

# kind, size, volume of the closed form
GEOMS = [
    ("box", (0.01, 0.014, 0.027), 8 * 0.01 * 0.014 * 0.027),
    ("sphere", (0.02, 0, 0), 4 / 3 * np.pi * 0.02**3),
    ("capsule", (0.01, 0.02, 0), 4 / 3 * np.pi * 0.01**3 + np.pi * 0.01**2 * 0.04),
    ("cylinder", (0.01, 0.02, 0), np.pi * 0.01**2 * 0.04),
    ("ellipsoid", (0.01, 0.02, 0.03), 4 / 3 * np.pi * 0.01 * 0.02 * 0.03),
]


@pytest.mark.parametrize(("kind", "size", "volume"), GEOMS)
def test_a_drawn_geom_lies_inside_its_closed_form_and_nearly_fills_it(kind, size, volume):
    vertices, faces, normals = geom.triangles(kind, size)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    points, face = trimesh.sample.sample_surface(mesh, 4000, seed=0)
    distance = signed_distance(kind, np.array(size, dtype=float), points, np.zeros((0, 4)))
    largest = {"box": geom.bevel(np.array(size)), "cylinder": geom.bevel(np.array(size[:2]))}.get(kind, 0)
    assert distance.max() < 1e-9
    # A rounded corner of a box is (sqrt 3 - 1) radii from the sharp one; the rest is tessellation.
    assert distance.min() > -(largest * 0.75 + 3e-4)
    assert 0.9 * volume < mesh.volume < volume
    outwards = mesh.face_normals[face]
    assert ((points * outwards).sum(axis=1) > 0).all()
    assert np.allclose(np.linalg.norm(normals, axis=1), 1)
    real = mesh.area_faces > 1e-12
    assert ((normals[faces[real]] * mesh.face_normals[real][:, None]).sum(axis=-1) > 0.6).all()


def test_a_mesh_geom_is_drawn_as_it_is():
    box = trimesh.creation.box((1, 2, 3))
    vertices, faces, normals = geom.triangles("mesh", np.zeros(3), box.vertices, box.faces)
    assert np.array_equal(vertices[faces], box.triangles)
    assert np.allclose(normals[faces], box.face_normals[:, None])


def test_bridges_join_boxes_that_touch_and_no_others():
    sizes = np.array([[1.0, 2, 1], [1, 1, 1], [1, 1, 1]])
    positions = np.array([[0.0, 0, 0], [0, 0.5, -2], [3.5, 0, 0]])
    ((size, position),) = geom.bridges(sizes, positions)
    low, high = position - size, position + size
    assert np.allclose([low[2], high[2]], [-2, 0])
    assert np.allclose([low[:2], high[:2]], [[-1, -0.5], [1, 1.5]], atol=2 * geom.RECESS)
    assert low[0] > -1 and high[0] < 1
