"""The distance between surfaces against closed forms, other libraries and independent samples."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from palpate.mesh.decimate import decimate
from palpate.mesh.distance import Surface
from studies.surface_distance import distances, sample


def surface(mesh):
    return Surface(mesh.vertices, mesh.faces)


def bumpy_torus():
    torus = trimesh.creation.torus(0.3, 0.1, major_sections=80, minor_sections=40)
    vertices = torus.vertices * (1 + 0.02 * np.sin(30 * torus.vertices))
    return np.array(vertices), np.array(torus.faces)


def test_inscribed_polyhedron_is_a_sagitta_away():
    """A prism in a cylinder: its sides are R (1 - cos(pi/n)) inside, on average 2/3 of that."""
    n, fine, radius = 12, 960, 1.0
    rough = trimesh.creation.cylinder(radius=radius, height=1, sections=n)
    round_ = trimesh.creation.cylinder(radius=radius, height=1, sections=fine)
    for tube in (rough, round_):
        tube.update_faces(np.abs(tube.face_normals[:, 2]) < 0.5)
    mean, largest = distances(surface(rough), surface(round_))
    sagitta = radius * (1 - np.cos(np.pi / n))
    assert largest == pytest.approx(sagitta, rel=5e-3)
    assert mean == pytest.approx(sagitta * 2 / 3, rel=2e-2)


@pytest.mark.parametrize("gap", [0.001, 0.3])
def test_parallel_plates(gap):
    plate = trimesh.creation.box(extents=(1, 1, 0)).subdivide()
    moved = plate.copy().apply_translation((0, 0, gap))
    assert distances(surface(plate), surface(moved)) == pytest.approx((gap, gap))


def test_equal_surfaces_are_nowhere_apart():
    ball = trimesh.creation.icosphere(subdivisions=3)
    assert distances(surface(ball), surface(ball))[1] < 1e-12


def test_the_distance_of_a_decimated_surface_to_itself_is_rounding():
    level = Surface(*decimate(*bumpy_torus(), 2000))
    assert 0 < distances(level, level)[1] < 1e-9


def test_of_a_decimated_surface_it_holds_against_samples_both_ways():
    """Points by trimesh, distances by a k-d tree over 300,000 points of the other surface."""
    whole = bumpy_torus()
    level = decimate(*whole, 2000)
    meshes = [trimesh.Trimesh(*each, process=False) for each in (whole, level)]
    for start, end in (meshes, meshes[::-1]):
        mean, largest = distances(surface(start), surface(end))
        points, _ = trimesh.sample.sample_surface(start, 10_000, seed=1)
        dense, _ = trimesh.sample.sample_surface(end, 300_000, seed=2)
        apart, _ = cKDTree(dense).query(points)
        spacing = np.sqrt(end.area / 300_000)
        # The nearest sample is up to about a spacing beside the nearest point.
        floor = np.sqrt(np.maximum(apart**2 - (2 * spacing) ** 2, 0))
        assert floor.max() <= largest * 1.02
        assert largest <= apart.max() * 1.3
        assert floor.mean() <= mean <= apart.mean()


def test_distance_has_a_direction():
    """A small plate is near a large one everywhere; the large one's corner is far from the small one."""
    small = trimesh.creation.box(extents=(1, 1, 0))
    large = trimesh.creation.box(extents=(3, 3, 0))
    small, large = surface(small), surface(large)
    assert distances(small, large)[1] < 1e-12 and distances(large, small)[1] == pytest.approx(np.sqrt(2))


@pytest.mark.parametrize("seed", range(2))
def test_mean_and_largest_hold_against_independent_samples(seed):
    """Points drawn by trimesh, distances by a k-d tree over a dense sample."""
    rng = np.random.default_rng(seed)
    source = trimesh.creation.icosphere(subdivisions=2)
    source.vertices *= rng.uniform(0.8, 1.2, (len(source.vertices), 1))
    target = trimesh.creation.box(extents=rng.uniform(0.5, 2, 3))
    mean, largest = distances(surface(source), surface(target))
    points, _ = trimesh.sample.sample_surface(source, 20_000, seed=seed)
    dense, _ = trimesh.sample.sample_surface(target, 400_000, seed=seed)
    apart, _ = cKDTree(dense).query(points)
    spacing = np.sqrt(target.area / 400_000)
    # The nearest sample is up to about a spacing beside the nearest point.
    assert np.sqrt(max(apart.max() ** 2 - (2 * spacing) ** 2, 0)) <= largest * 1.02
    assert largest <= apart.max() * 1.1
    assert apart.mean() == pytest.approx(mean, abs=0.01 * apart.mean() + spacing)


def test_sample_is_even_by_area():
    """Of two plates, one with four times the area, in triangles of very different size."""
    large = trimesh.creation.box(extents=(2, 2, 0)).subdivide().subdivide()
    small = trimesh.creation.box(extents=(1, 1, 0)).apply_translation((5, 0, 0))
    both = trimesh.util.concatenate([large, small])
    points = sample(np.array(both.vertices), np.array(both.faces), 10_000)
    assert (points[:, 0] < 3).mean() == pytest.approx(0.8, abs=0.002)
    count, _, _ = np.histogram2d(*points[points[:, 0] < 3, :2].T, bins=4, range=[(-1, 1), (-1, 1)])
    assert np.allclose(count, 500, rtol=0.1)
