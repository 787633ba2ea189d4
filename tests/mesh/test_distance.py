"""The stated distance between surfaces against closed forms, other libraries and independent samples."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from palpate.mesh import distance as measured
from palpate.mesh.distance import Surface, distance

WORK = 100_000
numbers = st.floats(-1, 1).map(lambda value: round(value, 3))


def surface(mesh):
    return Surface(mesh.vertices, mesh.faces)


def test_inscribed_polyhedron_is_a_sagitta_away():
    """A prism in a cylinder: its sides are R (1 - cos(pi/n)) inside, on average 2/3 of that."""
    n, fine, radius = 12, 960, 1.0
    rough = trimesh.creation.cylinder(radius=radius, height=1, sections=n)
    round_ = trimesh.creation.cylinder(radius=radius, height=1, sections=fine)
    for tube in (rough, round_):
        tube.update_faces(np.abs(tube.face_normals[:, 2]) < 0.5)
    found = distance(surface(rough), surface(round_))
    sagitta = radius * (1 - np.cos(np.pi / n))
    assert found["max"] == pytest.approx(sagitta, rel=5e-3)
    assert found["mean"] == pytest.approx(sagitta * 2 / 3, rel=2e-2)


@pytest.mark.parametrize("gap", [0.001, 0.3])
def test_parallel_plates(gap):
    plate = trimesh.creation.box(extents=(1, 1, 0)).subdivide()
    moved = plate.copy().apply_translation((0, 0, gap))
    found = distance(surface(plate), surface(moved))
    assert found["mean"] == pytest.approx(gap)
    assert found["max"] == pytest.approx(gap)


def test_equal_surfaces_are_nowhere_apart():
    ball = trimesh.creation.icosphere(subdivisions=3)
    found = distance(surface(ball), surface(ball), work=WORK)
    assert found["max"] < 1e-12
    assert found["max_bound"] <= measured.ABSOLUTE_GAP


def test_distance_has_a_direction():
    """A small plate is near a large one everywhere; the large one's corner is far from the small one."""
    small = trimesh.creation.box(extents=(1, 1, 0))
    large = trimesh.creation.box(extents=(3, 3, 0))
    assert distance(surface(small), surface(large))["max"] < 1e-12
    assert distance(surface(large), surface(small))["max"] == pytest.approx(np.sqrt(2))


@pytest.mark.parametrize("seed", range(4))
def test_the_bound_holds_for_independent_samples(seed):
    """Points drawn by trimesh, distances by a k-d tree over a dense sample."""
    rng = np.random.default_rng(seed)
    source = trimesh.creation.icosphere(subdivisions=2)
    source.vertices *= rng.uniform(0.8, 1.2, (len(source.vertices), 1))
    target = trimesh.creation.box(extents=rng.uniform(0.5, 2, 3))
    found = distance(surface(source), surface(target), work=WORK)
    points, _ = trimesh.sample.sample_surface(source, 20_000, seed=seed)
    dense, _ = trimesh.sample.sample_surface(target, 400_000, seed=seed)
    apart, _ = cKDTree(dense).query(points)
    spacing = np.sqrt(target.area / 400_000)
    assert apart.max() <= found["max_bound"] + 3 * spacing
    assert found["max"] <= found["max_bound"] <= found["max"] * 1.11
    assert (
        distance(surface(source), surface(target))["max"] >= found["max"] * 0.97
    )  # without branch and bound
    assert apart.mean() == pytest.approx(found["mean"], abs=0.01 * apart.mean() + spacing)


@given(corners=st.lists(numbers, min_size=9, max_size=9), point=st.lists(numbers, min_size=3, max_size=3))
@settings(max_examples=200, deadline=None)
def test_point_to_triangle_as_trimesh_has_it(corners, point):
    triangle, point = np.reshape(corners, (1, 3, 3)), np.array([point])
    side = triangle[0] - np.roll(triangle[0], 1, axis=0)
    if np.linalg.norm(np.cross(side[0], side[1])) < 1e-3:
        return  # trimesh's own formula divides by the area
    expected = np.linalg.norm(trimesh.triangles.closest_point(triangle, point) - point)
    assert measured.point_triangle_distance(point[None], triangle) == pytest.approx(expected, abs=1e-9)


@given(ends=st.lists(numbers, min_size=12, max_size=12))
@settings(max_examples=200, deadline=None)
def test_segment_to_segment_against_a_grid(ends):
    a, b, c, d = np.reshape(ends, (4, 1, 3))
    steps = np.linspace(0, 1, 101)[:, None]
    grid = np.linalg.norm((a + steps * (b - a))[:, None] - (c + steps * (d - c))[None], axis=2).min()
    found = measured.segment_distance(a, b, c, d)[0]
    half_step = (np.linalg.norm(b - a) + np.linalg.norm(d - c)) / 200
    assert grid - half_step - 1e-9 <= found <= grid + 1e-9


@given(st.lists(numbers, min_size=12, max_size=12), st.lists(numbers, min_size=9, max_size=9))
@settings(max_examples=200, deadline=None)
def test_bound_over_two_faces_is_one(corners, triangle):
    """No sampled point of a triangle is farther from a folded pair of faces than the bound says."""
    pair = Surface(np.reshape(corners, (4, 3)), np.array([[0, 1, 2], [1, 0, 3]]))
    triangle = np.reshape(triangle, (1, 3, 3))
    bound = measured._bound_by_pair(triangle, pair, np.array([0]))[0]
    weights = np.random.default_rng(0).dirichlet((0.5, 0.5, 0.5), 200)
    both = pair.vertices[pair.faces]
    points = np.repeat((weights @ triangle[0])[None], 2, axis=0)
    assert measured.point_triangle_distance(points, both).min(axis=0).max() <= bound + 1e-9


def test_sample_is_even_by_area():
    """Of two plates, one with four times the area, in triangles of very different size."""
    large = trimesh.creation.box(extents=(2, 2, 0)).subdivide().subdivide()
    small = trimesh.creation.box(extents=(1, 1, 0)).apply_translation((5, 0, 0))
    both = trimesh.util.concatenate([large, small])
    points = measured.sample(np.array(both.vertices), np.array(both.faces), 10_000)
    assert (points[:, 0] < 3).mean() == pytest.approx(0.8, abs=0.002)
    count, _, _ = np.histogram2d(*points[points[:, 0] < 3, :2].T, bins=4, range=[(-1, 1), (-1, 1)])
    assert np.allclose(count, 500, rtol=0.1)
