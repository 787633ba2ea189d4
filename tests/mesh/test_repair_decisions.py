"""What repairing decides between two faces, sides or shells: by how much, and what stays when there is no reason."""

import numpy as np
import pytest
import trimesh

from palpate.mesh.repair import repair

BALL = trimesh.creation.icosphere(subdivisions=1)


def repaired(*meshes):
    """The repair of meshes as one part, its `keep` and `flip` as one array for each mesh."""
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, first, strict=False)])
    found = repair(vertices, faces, np.zeros(len(faces), dtype=int))
    ends = np.cumsum([len(mesh.faces) for mesh in meshes])[:-1]
    return np.split(found.keep, ends), np.split(found.flip, ends)


def sheet(side=4):
    """A square of 2 side^2 faces, 1 across, that faces up."""
    line = np.linspace(-0.5, 0.5, side + 1)
    x, y = np.meshgrid(line, line)
    corner = np.arange(side)[:, None] * (side + 1) + np.arange(side)
    a, b, c, d = (corner.ravel() + step for step in (0, 1, side + 2, side + 1))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return trimesh.Trimesh(np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1), faces, process=False)


def test_a_closed_shell_of_thin_faces_alone_goes_and_one_with_thin_faces_stays():
    """A tetrahedron whose corners are on a line is closed, and no crack of it could open."""
    corners = np.array([0, 1, 2, 3])[:, None] * [1.0, 0, 0] + [5, 0, 0]
    needle = trimesh.Trimesh(corners, [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]], process=False)
    (ball, thin), _ = repaired(BALL, needle)
    assert ball.all() and not thin.any()
    # A corner on an edge of a ball: the face between the three closes the crack that it makes.
    faces, vertices = BALL.faces.copy(), BALL.vertices
    a, b, c = faces[0]
    middle = len(vertices)
    split = [(a, middle, c), (middle, b, c), (a, b, middle)]
    cracked = trimesh.Trimesh(np.r_[vertices, [vertices[[a, b]].mean(axis=0)]], np.r_[faces[1:], split], process=False)
    ((keep,), _) = repaired(cracked)
    assert keep.all()


def shaded(size):
    """Whether a sheet that has a box of this size before its front, as wide as high, is turned."""
    box = trimesh.creation.box((size, size, size), trimesh.transformations.translation_matrix((0.1, 0.1, 0.3)))
    _, (flip, _) = repaired(sheet(), box)
    assert flip.all() or not flip.any()
    return flip.any()


def test_an_open_sheet_stays_as_it_is_unless_its_back_is_seen_clearly_more():
    """A box a tenth as wide hides a few of the rays from its front, one of four tenths many."""
    assert not shaded(0.1) and shaded(0.4)


@pytest.mark.parametrize("count", [1, 5, 15])
def test_of_faces_that_run_against_each_other_the_fewer_are_turned(count):
    """The first face, from which the others are reached, is one of them."""
    mesh, turned = sheet(), np.r_[True, np.random.default_rng(count).permutation(31) < count - 1]
    mesh.faces[turned] = mesh.faces[turned][:, ::-1]
    _, (flip,) = repaired(mesh)
    np.testing.assert_array_equal(flip, turned)


@pytest.mark.parametrize("first", [True, False])
def test_of_as_many_the_first_face_stays(first):
    mesh, turned = sheet(), np.random.default_rng(0).permutation(32) < 16
    turned = turned if turned[0] == first else ~turned
    mesh.faces[turned] = mesh.faces[turned][:, ::-1]
    _, (flip,) = repaired(mesh)
    np.testing.assert_array_equal(flip, turned != first)
