"""Surface points: on the exterior and nowhere else, uniform by area, whatever the state of the mesh."""

import igl
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from palpate.surface import sample

COUNT = 10_000


def random(seed=0):
    return np.random.default_rng(seed)


def fine_box(size, subdivisions=2):
    mesh = trimesh.creation.box((size,) * 3)
    for _ in range(subdivisions):
        mesh = mesh.subdivide()
    return mesh


def open_cup(radius, depth):
    """A tube without thickness, closed at the bottom (z = 0), open at the top (z = depth)."""
    angle = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    ring = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    vertices = np.concatenate(
        [np.column_stack([ring, np.zeros(64)]), np.column_stack([ring, np.full(64, depth)]), [[0, 0, 0]]]
    )
    here, there = np.arange(64), (np.arange(64) + 1) % 64
    wall = np.concatenate([np.column_stack([here, there, 64 + here]), np.column_stack([there, 64 + there, 64 + here])])
    return trimesh.Trimesh(vertices, np.concatenate([wall, np.column_stack([np.full(64, 128), there, here])]))


def distance_to(mesh, points):
    squared, _, _ = igl.point_mesh_squared_distance(
        points, np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int64)
    )
    return np.sqrt(squared)


def naive_distance(triangles, points):
    """Distance to the nearest triangle; unlike libigl's it can be trusted on needles."""
    nearest = np.full(len(points), np.inf)
    for corner in triangles:
        normal = np.cross(corner[1] - corner[0], corner[2] - corner[0])
        inside = np.full(len(points), bool(normal.any()))
        for start, stop in zip(corner, np.roll(corner, -1, axis=0), strict=True):
            along = stop - start
            part = np.clip((points - start) @ along / max(along @ along, 1e-300), 0, 1)
            nearest = np.minimum(nearest, np.linalg.norm(points - start - part[:, None] * along, axis=1))
            inside &= (points - start) @ np.cross(normal, along) >= 0
        if inside.any():
            above = np.abs((points[inside] - corner[0]) @ normal) / np.linalg.norm(normal)
            nearest[inside] = np.minimum(nearest[inside], above)
    return nearest


def spread(cells, cell_count):
    """Chi-square of points over cells of equal area, as a quantile of its distribution."""
    observed = np.bincount(cells, minlength=cell_count)
    expected = len(cells) / cell_count
    return chi2.cdf(((observed - expected) ** 2 / expected).sum(), cell_count - 1)


def cells_of_a_box(points, size, n):
    """Which of the 6 n n equal squares of a box's surface each point is on."""
    axis = np.abs(points).argmax(axis=1)
    side = points[np.arange(len(points)), axis] > 0
    across = np.array([[1, 2], [0, 2], [0, 1]])[axis]
    place = np.take_along_axis(points, across, axis=1) / size + 0.5
    u, v = np.minimum((place * n).astype(int), n - 1).T
    return ((axis * 2 + side) * n + u) * n + v


def test_points_lie_on_the_mesh():
    mesh = trimesh.creation.torus(0.2, 0.06)
    points = sample(mesh, COUNT, random())
    assert points.shape == (COUNT, 3) and points.dtype == np.float64
    assert distance_to(mesh, points).max() < 1e-9


def test_a_box_inside_a_box_gets_no_points():
    mesh = trimesh.util.concatenate([fine_box(0.2), fine_box(0.19), fine_box(0.05)])
    points = sample(mesh, COUNT, random())
    np.testing.assert_allclose(np.abs(points).max(axis=1), 0.1, atol=1e-9)


def test_uniform_on_a_box_with_very_unequal_faces():
    # One side in slivers and tiny faces, the others of two faces each.
    mesh = trimesh.creation.box((0.2,) * 3)
    chosen = np.flatnonzero(mesh.face_normals[:, 0] > 0.5)
    for _ in range(6):
        mesh = mesh.subdivide(face_index=chosen[:1])
        chosen = np.flatnonzero(mesh.face_normals[:, 0] > 0.5)
    points = sample(mesh, COUNT, random(1))
    assert spread(cells_of_a_box(points, 0.2, 6), 216) < 0.999


def test_uniform_on_a_sphere():
    points = sample(trimesh.creation.icosphere(subdivisions=5, radius=0.25), COUNT, random(2))
    # Equal areas: height (Archimedes) and angle.
    height = np.minimum(((points[:, 2] / 0.25 + 1) / 2 * 12).astype(int).clip(0), 11)
    angle = ((np.arctan2(points[:, 1], points[:, 0]) / (2 * np.pi) % 1) * 12).astype(int).clip(0, 11)
    assert spread(height * 12 + angle, 144) < 0.999


def test_moments_of_a_sphere_a_torus_and_a_cylinder(n=40_000, share=0.001):
    # Over a sphere the mean of x^2 is r^2/3; over a torus that of z^2 is r^2/2, of x^2 + y^2 R^2 + 3 r^2/2.
    sphere = sample(trimesh.creation.icosphere(subdivisions=5, radius=0.25), n, random(3))
    sigma = 0.25**2 * np.sqrt(4 / 45) / np.sqrt(n)
    np.testing.assert_allclose((sphere**2).mean(axis=0), 0.25**2 / 3, atol=4.5 * sigma + share * 0.25**2 / 3)
    np.testing.assert_allclose(sphere.mean(axis=0), 0, atol=4.5 * 0.25 / np.sqrt(3 * n))

    ring = sample(trimesh.creation.torus(0.2, 0.06, major_sections=128, minor_sections=64), n, random(4))
    assert (ring[:, 2] ** 2).mean() == pytest.approx(0.06**2 / 2, rel=0.02 + share)
    assert (ring[:, :2] ** 2).sum(axis=1).mean() == pytest.approx(0.2**2 + 1.5 * 0.06**2, rel=0.01 + share)

    # A cylinder's caps have r / (r + h) of its area.
    tube = sample(trimesh.creation.cylinder(radius=0.1, height=0.3, sections=256), n, random(5))
    caps = (np.abs(tube[:, 2]) > 0.15 - 1e-9).mean()
    assert caps == pytest.approx(0.25, abs=4.5 * np.sqrt(0.25 * 0.75 / n) + share)


def test_interpenetrating_spheres_get_points_on_their_union_only():
    parts = [trimesh.creation.icosphere(subdivisions=4, radius=0.1) for _ in range(2)]
    parts[1].apply_translation((0.1, 0, 0))
    points = sample(trimesh.util.concatenate(parts), COUNT, random())
    # Faces lie inside the spheres by up to 0.2 mm.
    for centre in (0.0, 0.1):
        assert np.linalg.norm(points - [centre, 0, 0], axis=1).min() > 0.0997
    # By symmetry half on each; nothing of the caps inside the other (a quarter of each sphere, at x = 0.05).
    left = np.linalg.norm(points, axis=1) < 0.1001
    assert left.mean() == pytest.approx(0.5, abs=0.025)


def test_touching_faces_of_two_boxes_are_hidden():
    mesh = trimesh.util.concatenate([fine_box(0.1), fine_box(0.1).apply_translation((0.1, 0, 0))])
    points = sample(mesh, COUNT, random())
    seam = np.abs(points[:, 0] - 0.05) < 1e-6
    assert not (seam & (np.abs(points[:, 1:]).max(axis=1) < 0.0499)).any()


def test_both_sides_of_an_open_cup_and_its_bottom():
    radius, depth = 0.05, 0.1
    points = sample(open_cup(radius, depth), COUNT, random())
    bottom = (points[:, 2] < 1e-9).mean()
    assert bottom == pytest.approx(radius / (radius + 2 * depth), abs=0.02)


def test_what_is_seen_through_an_opening_is_exterior_and_a_sealed_cavity_is_not():
    outer, core = fine_box(0.2), fine_box(0.05)
    sealed = trimesh.util.concatenate([outer, core])
    lid = outer.triangles_center[:, 2] > 0.0999
    opened = trimesh.util.concatenate([trimesh.Trimesh(outer.vertices, outer.faces[~lid], process=False), core])
    assert (np.abs(sample(sealed, COUNT, random())).max(axis=1) > 0.09).all()
    on_core = np.abs(sample(opened, COUNT, random())).max(axis=1) < 0.03
    # 6 x 0.05^2 of 5 x 0.2^2 + 6 x 0.05^2: the core is seen on all sides (off the walls) but perhaps below.
    assert on_core.mean() == pytest.approx(0.07, abs=0.015)


def test_winding_does_not_matter():
    mesh = fine_box(0.2)
    faces = np.where(random().random(len(mesh.faces))[:, None] < 0.5, mesh.faces, mesh.faces[:, ::-1])
    flipped = trimesh.Trimesh(mesh.vertices, faces, process=False)
    points = sample(flipped, COUNT, random(6))
    assert spread(cells_of_a_box(points, 0.2, 6), 216) < 0.999


def test_same_generator_same_points():
    mesh = trimesh.creation.torus(0.2, 0.06)
    first, second, other = (sample(mesh, 1000, random(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, second)
    assert not np.array_equal(first, other)


def test_a_defective_mesh_gives_the_points_of_its_sound_faces():
    box = fine_box(0.2)
    vertices = np.concatenate([box.vertices, [[np.nan] * 3, [np.inf, 0, 0], [1e6, 0, 0]]])
    n = len(box.vertices)
    bad = [[0, 0, 1], [2, 2, 2], [0, 1, n], [n + 1, 2, 3]]
    doubled = np.concatenate([bad, box.faces, box.faces[::2, ::-1]])
    points = sample(trimesh.Trimesh(vertices, doubled, process=False, validate=False), COUNT, random())
    np.testing.assert_allclose(np.abs(points).max(axis=1), 0.1, atol=1e-9)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10_000), faces=st.integers(2, 60), flat=st.sampled_from([1.0, 1e-3, 1e-9, 0.0]))
def test_triangle_soup(seed, faces, flat):
    corners = random(seed).normal(size=(faces, 3, 3)) * [0.1, 0.1, 0.1 * flat]
    corners[0, 2] = corners[0, 1] + 1e-9
    soup = trimesh.Trimesh(corners.reshape(-1, 3), np.arange(3 * faces).reshape(-1, 3), process=False)
    points = sample(soup, 500, random(seed))
    assert points.shape == (500, 3)
    assert naive_distance(corners, points).max() < 1e-9


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_any_unit(scale):
    mesh = trimesh.util.concatenate([fine_box(0.2 * scale), fine_box(0.1 * scale)])
    mesh.apply_translation((3 * scale, 0, 0))
    points = (sample(mesh, COUNT, random(7)) - [3 * scale, 0, 0]) / scale
    np.testing.assert_allclose(np.abs(points).max(axis=1), 0.1, atol=1e-9)
    assert spread(cells_of_a_box(points, 0.2, 6), 216) < 0.999


def test_one_flat_square_is_sampled_on_its_own():
    square = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    points = sample(square, 1000, random())
    np.testing.assert_allclose(points.mean(axis=0), [0.5, 0.5, 0], atol=0.05)


def test_refusals_say_what_was_expected():
    with pytest.raises(ValueError, match="area"):
        sample(trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]], process=False), 10, random())
