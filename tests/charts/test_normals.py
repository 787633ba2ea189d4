import numpy as np
import trimesh
from scipy.spatial import cKDTree

from palpate.charts import plane_normals


def test_normals_of_points_on_a_sphere_are_its_radii():
    points = trimesh.creation.icosphere(subdivisions=4, radius=0.1).vertices
    normals = plane_normals(points, cKDTree(points))
    parallel = np.abs((normals * points).sum(axis=1)) / 0.1
    assert np.degrees(np.arccos(np.clip(parallel, 0, 1))).max() < 3


def test_normals_of_an_ellipsoid():
    """In closed form: the gradient of x^2/a^2 + y^2/b^2 + z^2/c^2; a good part are of either sign."""
    axes = np.array([0.1, 0.15, 0.2])
    directions = np.random.default_rng(0).standard_normal((10_000, 3))
    points = directions / np.linalg.norm(directions, axis=1, keepdims=True) * axes
    found = plane_normals(points, cKDTree(points))
    expected = points / axes**2
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    cosines = np.abs((found * expected).sum(axis=1))
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1)
    assert cosines.min() > np.cos(np.radians(10)) and cosines.mean() > np.cos(np.radians(2))
