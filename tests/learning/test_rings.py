import numpy as np
import pytest
import torch
import trimesh
from scipy.spatial.transform import Rotation

from palpate import store
from palpate.learning.metrics import ring_distances
from palpate.learning.rings import (
    GRID,
    RING,
    RINGS,
    CloudSurface,
    MeshSurface,
    plane,
    project_batch,
    reach,
    ring_points,
)
from palpate.sensor import DIGIT
from palpate.touch import SENSOR_WIDTH, RayCaster, empty_reading, sense

RADIUS = 0.08
OBLIQUE = Rotation.from_euler("xyz", [0.4, -0.9, 0.2]).as_matrix()
STRAIGHT = np.eye(3)
POSITION = np.array([0.03, -0.01, 0.6])


def slab(distance: float, width: float, rotation=STRAIGHT, position=(0, 0, 0)) -> trimesh.Trimesh:
    """A thin square plate, `distance` ahead of a sensor and perpendicular to its x."""
    mesh = trimesh.creation.box((0.002, width, width))
    mesh.apply_translation((distance + 0.001, 0, 0))
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = rotation, position
    return mesh.apply_transform(transform)


def test_rings_are_bands_between_squares():
    """Ring r: the points between the squares of r - 1 and r sensor widths; ring 1: the sensor itself."""
    counts = [int((ring == RING).sum()) for ring in RINGS]
    assert counts == [400 * (2 * ring - 1) for ring in RINGS] and sum(counts) == GRID**2
    y, z = plane(DIGIT.size)[:, 1:].T
    for ring in RINGS:
        far = np.maximum(np.abs(y), np.abs(z))[RING.ravel() == ring] / (SENSOR_WIDTH / 2)
        assert ring - 1 < far.min() and far.max() < ring
    spacing = np.diff(np.unique(y))
    assert np.allclose(spacing, 5 * SENSOR_WIDTH / GRID) and np.isclose(y.mean(), 0)


def test_on_a_plate_every_point_is_at_its_distance():
    surface = MeshSurface(slab(0.01, 0.2, OBLIQUE, POSITION))
    depth = surface.project(POSITION, OBLIQUE)
    assert np.allclose(depth, 0.01, atol=1e-6)
    for ring, points in zip(RINGS, ring_points(depth, POSITION, OBLIQUE), strict=True):
        local = (points - POSITION) @ OBLIQUE
        assert len(points) == 400 * (2 * ring - 1) and np.allclose(local[:, 0], 0.01, atol=1e-6)


def test_the_objects_position_is_where_its_frame_is():
    surface = MeshSurface(slab(0.01, 0.2, OBLIQUE), object_position=POSITION)
    assert np.allclose(surface.project(POSITION, OBLIQUE), 0.01, atol=1e-6)


def test_on_a_sphere_points_lie_where_the_equation_says():
    ball = trimesh.creation.icosphere(subdivisions=6, radius=RADIUS)
    gap = 0.015
    centre = POSITION + OBLIQUE[:, 0] * (RADIUS + gap)
    depth = MeshSurface(ball, centre).project(POSITION, OBLIQUE)
    across = (plane(DIGIT.size)[:, 1:] ** 2).sum(axis=1)
    expected = RADIUS + gap - np.sqrt(RADIUS**2 - across)
    assert np.allclose(depth.ravel(), expected, atol=2e-5)
    points = np.concatenate(ring_points(depth, POSITION, OBLIQUE))
    assert np.allclose(np.linalg.norm(points - centre, axis=1), RADIUS, atol=2e-5)


def test_rays_that_pass_by_are_left_out():
    """A plate of three sensor widths: rings 1 to 3 are whole, 4 and 5 are empty."""
    depth = MeshSurface(slab(0.01, 3 * SENSOR_WIDTH)).project(np.zeros(3), np.eye(3))
    assert [len(points) for points in ring_points(depth, np.zeros(3), np.eye(3))] == [400, 1200, 2000, 0, 0]


def test_another_part_far_behind_is_left_out():
    near, width = slab(0.01, SENSOR_WIDTH), 0.2
    for share, counts in ((0.95, [400, 1200, 2000, 2800, 3600]), (1.05, [400, 0, 0, 0, 0])):
        both = trimesh.util.concatenate([near, slab(share * reach(DIGIT), width)])
        depth = MeshSurface(both).project(np.zeros(3), np.eye(3))
        assert [len(points) for points in ring_points(depth, np.zeros(3), np.eye(3))] == counts


def test_what_is_behind_the_sensor_is_left_out():
    depth = MeshSurface(slab(-0.01, 0.2)).project(np.zeros(3), np.eye(3))
    assert np.isinf(depth).all()


def test_in_the_sensors_own_square_rings_are_the_touch_depth():
    """By the ray casting of the touch package, in double precision, at the grid's points that are pixels."""
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.02)
    centre = np.array([0.025, 0.003, -0.002])
    touch = RayCaster(ball, centre).trace(np.zeros((1, 3)), np.eye(3)[None])[0]
    rings = MeshSurface(ball, centre).project(np.zeros(3), np.eye(3))[40:60, 40:60]
    # Each point of the grid is in the middle of 5 x 5 pixels.
    middle = touch[2::5, 2::5]
    met = np.isfinite(middle)
    assert met.any() and np.allclose(rings[met], middle[met], atol=1e-6)


def test_a_cloud_stands_in_for_the_mesh():
    ball = trimesh.creation.icosphere(subdivisions=5, radius=RADIUS)
    centre = OBLIQUE[:, 0] * (RADIUS + 0.01)
    points, _ = trimesh.sample.sample_surface(ball, 10_000, seed=1)
    cloud = CloudSurface(points + centre)
    depth = cloud.project(np.zeros(3), OBLIQUE)
    true = MeshSurface(ball, centre).project(np.zeros(3), OBLIQUE)
    assert np.isfinite(depth).mean() > 0.99
    error = np.abs(depth - true)[np.isfinite(depth)]
    assert np.median(error) < 5e-4 and np.quantile(error, 0.99) < cloud.radius
    # Discs are as wide as the points are apart: five neighbours in pi r^2 of the sphere's area.
    area = 4 * np.pi * RADIUS**2
    assert cloud.radius == pytest.approx(np.sqrt(5 * area / 10_000 / np.pi), rel=0.1)
    assert np.isinf(cloud.project(np.array([0.0, 0.0, 1.0]), OBLIQUE)).all()


def test_a_cloud_of_a_few_points_is_an_error():
    with pytest.raises(ValueError, match="5 points"):
        CloudSurface(np.zeros((5, 3)))


def test_distances_are_those_of_all_pairs():
    rng = np.random.default_rng(0)
    rings = [rng.normal(size=(count, 3)) for count in (5, 1, 0, 30, 12)]
    prediction = rng.normal(size=(70, 3))
    expected = [
        ((ring[:, None] - prediction[None]) ** 2).sum(axis=2).min(axis=1).mean() if len(ring) else np.nan
        for ring in rings
    ]
    found = ring_distances(rings, torch.from_numpy(prediction).float())
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_a_prediction_at_a_distance_is_that_distance_away():
    """A plate predicted h too far: h squared, but for the spacing of the points on it."""
    height = 0.004
    depth = MeshSurface(slab(0.01, 0.2)).project(np.zeros(3), np.eye(3))
    side = np.arange(-0.06, 0.06, 0.001)
    y, z = np.meshgrid(side, side)
    plate = np.stack([np.full(y.size, 0.01 + height), y.ravel(), z.ravel()], axis=1)
    distances = ring_distances(ring_points(depth, np.zeros(3), np.eye(3)), torch.from_numpy(plate))
    # Within a cell of 1 mm the mean squared distance to its corner is 2 (1 mm)^2 / 12.
    np.testing.assert_allclose(distances, height**2 + 2 * 0.001**2 / 12, rtol=0.02)


def test_a_batch_has_rings_around_successful_touches_only(tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    ahead, away = OBLIQUE, Rotation.from_euler("z", 180, degrees=True).as_matrix() @ OBLIQUE
    position = np.zeros((4, 4, 3))
    rotation = np.stack([[ahead, away, ahead, ahead]] * 4)
    centre = OBLIQUE[:, 0] * 0.07
    tracer = RayCaster(ball, centre)
    sensed = [sense(tracer, *pose) for pose in zip(position, rotation, strict=True)]
    assert sensed[0].success.tolist() == [True, False, True, True]
    arrays = {name: np.stack([getattr(each, name) for each in sensed]) for name in sensed[0]._fields}
    arrays |= {"position": position, "rotation": rotation}
    arrays = {name: values.reshape(2, 2, *values.shape[1:]) for name, values in arrays.items()}
    path = tmp_path / "touch" / "batch-0000.zarr"
    store.write(
        path,
        "touch",
        arrays | {"object": np.array(["a", "b"]), "empty_reading": empty_reading()},
        {"seed": 0, "made_from": {}, "sensor": DIGIT.description()},
    )
    surfaces = {"a": MeshSurface(ball, centre), "b": MeshSurface(slab(0.02, 0.2, ahead))}
    rings = project_batch(path, lambda name, sensor: surfaces[name])
    assert rings["object"].tolist() == ["a", "b"] and rings["ring_depth"].shape == (2, 2, 4, GRID, GRID)
    assert np.isinf(rings["ring_depth"][:, :, 1]).all()
    expected = surfaces["a"].project(position[1, 2], rotation[1, 2])
    np.testing.assert_array_equal(rings["ring_depth"][0, 1, 2], expected)
    assert np.allclose(rings["ring_depth"][1][:, [0, 2, 3]], 0.02, atol=1e-6)
    store.write(tmp_path / "rings" / "batch-0000.zarr", "rings", rings, {"seed": 0, "made_from": {}})
