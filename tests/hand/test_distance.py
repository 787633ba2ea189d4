"""Closed-form distances against libigl's of meshes, against sampled surfaces, and as invariants."""

from itertools import permutations

import igl
import numpy as np
import pytest
import trimesh
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from palpate.hand.hand import half_spaces, signed_distance

SIZE = st.floats(0.005, 0.08)
COORDINATE = st.floats(-0.15, 0.15)
POINTS = st.lists(st.tuples(COORDINATE, COORDINATE, COORDINATE), min_size=1, max_size=20)
NO_PLANES = np.zeros((0, 4))


def solid(kind, size):
    """The same solid as a fine mesh."""
    if kind == "box":
        return trimesh.creation.box(2 * size)
    if kind == "sphere":
        return trimesh.creation.icosphere(subdivisions=4, radius=size[0])
    if kind == "capsule":
        mesh = trimesh.creation.capsule(height=2 * size[1], radius=size[0], count=[64, 64])
        mesh.apply_translation(-mesh.bounds.mean(axis=0))
        return mesh
    if kind == "ellipsoid":
        return trimesh.creation.icosphere(subdivisions=5).apply_scale(size)
    return trimesh.creation.cylinder(height=2 * size[1], radius=size[0], sections=128)


def mesh_distance(mesh, points):
    """Signed distance to a closed mesh, negative inside, by libigl."""
    vertices, faces = np.array(mesh.vertices, dtype=float), np.array(mesh.faces, dtype=np.int64)
    return igl.signed_distance(points, vertices, faces)[0]


KINDS = ["box", "sphere", "capsule", "cylinder", "ellipsoid"]


@pytest.mark.parametrize("kind", KINDS)
def test_distance_is_that_to_a_fine_mesh(kind):
    rng = np.random.default_rng(1)
    size = np.array([0.02, 0.035, 0.05])
    points = rng.uniform(-0.1, 0.1, (400, 3))
    expected = mesh_distance(solid(kind, size), points)
    # The mesh of a curved solid is inside it by the sagitta of its segments.
    np.testing.assert_allclose(signed_distance(kind, size, points, NO_PLANES), expected, atol=6e-5)


def test_distance_to_convex_mesh_is_exact_inside_and_not_too_far_outside():
    rng = np.random.default_rng(2)
    vertices = rng.uniform(-0.04, 0.04, (30, 3))
    points = rng.uniform(-0.06, 0.06, (800, 3))
    expected = mesh_distance(trimesh.convex.convex_hull(vertices), points)
    found = signed_distance("mesh", np.zeros(3), points, half_spaces(vertices))
    inside = expected < 0
    assert inside.sum() > 20
    np.testing.assert_allclose(found[inside], expected[inside], atol=1e-6)
    assert (found[~inside] >= -1e-8).all()
    assert (found[~inside] <= expected[~inside] + 1e-6).all()


@settings(deadline=None, max_examples=60)
@given(half_axes=st.tuples(SIZE, SIZE, SIZE), points=POINTS)
def test_ellipsoid_depth_is_never_understated(half_axes, points):
    half_axes, points = np.array(half_axes), np.array(points)
    surface = trimesh.creation.icosphere(subdivisions=3).vertices * half_axes
    found = signed_distance("ellipsoid", half_axes, points, NO_PLANES)
    inside = ((points / half_axes) ** 2).sum(axis=1) < 1
    np.testing.assert_array_equal(found < 0, inside)
    # Sampled, so never less than the true depth.
    to_surface = np.linalg.norm(points[:, None] - surface[None], axis=2).min(axis=1)
    spacing = 0.15 * half_axes.max()
    assert (-found[inside] >= to_surface[inside] - spacing).all()
    assert (-found <= half_axes.min() + 1e-12).all()


@settings(deadline=None, max_examples=60)
@given(half_axes=st.tuples(SIZE, SIZE, SIZE), unit=st.tuples(*[st.floats(-1, 1)] * 3), way=st.floats(0, 0.05))
@example(half_axes=(0.08, 0.08, 0.005), unit=(1, 0, 0), way=0)
@example(half_axes=(0.02, 0.02, 0.02), unit=(0, 0, 1), way=0.01)
def test_along_a_normal_outside_an_ellipsoid_the_distance_is_the_way(half_axes, unit, way):
    half_axes, unit = np.array(half_axes), np.array(unit)
    assume(np.linalg.norm(unit) > 1e-3)
    on_surface = half_axes * unit / np.linalg.norm(unit)
    normal = on_surface / half_axes**2
    point = on_surface + way * normal / np.linalg.norm(normal)
    assert signed_distance("ellipsoid", half_axes, point[None], NO_PLANES)[0] == pytest.approx(way, abs=1e-9)


@pytest.mark.parametrize("half_axes", list(permutations((0.03, 0.02, 0.005))))
def test_the_centre_of_an_ellipsoid_is_as_deep_as_its_shortest_half_axis(half_axes):
    centre = np.zeros((1, 3))
    assert signed_distance("ellipsoid", np.array(half_axes), centre, NO_PLANES)[0] == pytest.approx(-0.005, abs=1e-9)


@settings(deadline=None, max_examples=100)
@given(
    kind=st.sampled_from(KINDS),
    size=st.tuples(SIZE, SIZE, SIZE),
    points=POINTS,
    step=st.tuples(COORDINATE, COORDINATE, COORDINATE),
)
def test_distance_changes_by_at_most_the_step(kind, size, points, step):
    points, step = np.array(points), np.array(step)
    before = signed_distance(kind, np.array(size), points, NO_PLANES)
    after = signed_distance(kind, np.array(size), points + step, NO_PLANES)
    assert (np.abs(after - before) <= np.linalg.norm(step) + 1e-12).all()


def test_half_spaces_of_a_box_are_its_six_faces():
    planes = half_spaces(trimesh.creation.box((2, 4, 6)).vertices)
    assert len(planes) == 6
    np.testing.assert_allclose(np.sort(-planes[:, 3]), [1, 1, 2, 2, 3, 3])
