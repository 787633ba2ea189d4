"""Readings against pixels computed by hand and the symmetry of the lights; `sense` against its parts."""

import math

import numpy as np
import pytest
import trimesh
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from palpate.touch import (
    PIXEL_CENTRES,
    SENSOR_RANGE,
    RayCaster,
    empty_reading,
    impression,
    normals,
    sense,
    shade,
)

Y, Z = np.meshgrid(PIXEL_CENTRES, PIXEL_CENTRES)


def ball(radius=0.007, height=0.005):
    """Depth map of a ball pressed `height` deep into the middle of the sensor's range."""
    square = radius**2 - Y**2 - Z**2
    depth = np.where(square > 0, SENSOR_RANGE - height + radius - np.sqrt(np.maximum(square, 0)), np.inf)
    return np.where(depth <= SENSOR_RANGE, depth, np.inf)


def test_impression_is_zero_where_nothing_is_in_range():
    np.testing.assert_allclose(
        impression(np.array([0.0, 0.02, SENSOR_RANGE, 0.03, np.inf])), [0.025, 0.005, 0, 0, 0], atol=1e-15
    )


def test_normals_of_a_slope():
    normal = normals(0.005 + 0.4 * Y - 0.2 * Z)
    expected = np.array([-0.4, 0.2, 1]) / math.sqrt(1 + 0.4**2 + 0.2**2)
    np.testing.assert_allclose(normal, np.broadcast_to(expected, normal.shape), atol=1e-4)


def test_untouched_pixels_by_hand():
    # The lights are at height w, sqrt(2) w from the axis: the cosine at the centre is 1 / sqrt(3) = 0.57735,
    # and 255 times that is 147.2.
    reading = empty_reading()
    assert np.abs(reading[49:51, 49:51].astype(int) - 147).max() <= 1
    # Row 0, column 0: y = z = -0.00812295 m. Red is at (0, -0.03535534), so it is 0.00812295 to the right,
    # 0.02723239 up and 0.025 above: cosine 0.025 / 0.03784922 = 0.66051, times 255 = 168.4.
    assert reading[0, 0, 0] == 168
    # Green is at (0.03061862, 0.01767767): (0.03874157, 0.02580062, 0.025), 0.025 / 0.05284 -> 120.6.
    assert reading[0, 0, 1] == 121


def test_a_tilted_pixel_by_hand():
    # D' = 0.006 + 0.5 y: at row 50, column 60, y = 0.00172305, z = 0.00008205, D' = 0.00686153.
    # n = (-0.5, 0, 1) / 1.11803399.
    reading = shade(SENSOR_RANGE - (0.006 + 0.5 * Y))
    for channel, degrees in enumerate((-90, 30, 150)):
        light = (
            math.sqrt(2) * 0.025 * math.cos(math.radians(degrees)),
            math.sqrt(2) * 0.025 * math.sin(math.radians(degrees)),
            0.025,
        )
        towards = (light[0] - 0.00172305, light[1] - 0.00008205, light[2] - 0.00686153)
        cosine = (-0.5 * towards[0] + towards[2]) / 1.11803399 / math.hypot(*towards)
        assert abs(int(reading[50, 60, channel]) - 255 * max(cosine, 0)) <= 0.51


def test_mirrored_surface_swaps_green_and_blue():
    random = np.random.default_rng(0)
    depth = SENSOR_RANGE - 0.004 - 0.003 * np.sin(400 * Y + random.uniform()) * np.cos(300 * Z)
    mirrored = shade(depth[:, ::-1])
    assert np.abs(mirrored.astype(int) - shade(depth)[:, ::-1][..., [0, 2, 1]]).max() <= 1
    assert np.abs(shade(depth).astype(int) - mirrored).max() > 20


@pytest.mark.parametrize("depth", [np.full((100, 100), np.inf), ball()])
def test_a_third_of_a_turn_permutes_the_channels(depth):
    # A centred ball looks the same after 120 degrees, but for the lights: each takes the next one's place.
    reading = shade(depth).astype(float)
    angle = np.linspace(0, 2 * np.pi, 360, endpoint=False)
    for radius in (10.0, 20.0, 30.0):

        def ring(channel, turn, radius=radius):
            place = 49.5 + radius * np.stack([np.sin(angle + turn), np.cos(angle + turn)])
            return map_coordinates(reading[..., channel], place, order=1)

        for channel in range(3):
            turned = ring((channel + 1) % 3, 2 * np.pi / 3)
            assert np.abs(turned - ring(channel, 0)).mean() < 2
            assert np.abs(turned - ring(channel, 0)).max() < 15


def test_a_surface_that_faces_a_light_is_brightest_and_one_that_faces_away_is_dark():
    # At the light's elevation, slope sqrt(2), the surface faces it: falling towards -z (the top), red.
    reading = shade(SENSOR_RANGE - (0.004 + np.sqrt(2) * Z.clip(-0.002, 0.002)))
    assert reading[50, 50, 0] > 245
    assert (reading[50, 50, 1:] < 20).all()
    # The other way round it faces away from red: clipped at zero.
    away = shade(SENSOR_RANGE - (0.004 - np.sqrt(2) * Z.clip(-0.002, 0.002)))
    assert away[50, 50, 0] == 0
    assert (away[50, 50, 1:] > 100).all()


def test_no_touch_reads_empty():
    np.testing.assert_array_equal(shade(np.full((100, 100), np.inf)), empty_reading())
    np.testing.assert_array_equal(shade(np.full((100, 100), SENSOR_RANGE)), empty_reading())


def test_readings_of_a_stack_are_those_of_its_maps():
    stack = np.stack([ball(), ball(0.004), np.full((100, 100), np.inf)])
    np.testing.assert_array_equal(shade(stack), np.stack([shade(depth) for depth in stack]))


@pytest.fixture(scope="module")
def grasp():
    """A ball of 0.1 m at the object's place in the world, and four sensors of which two touch it."""
    rotation = Rotation.random(4, random_state=1).as_matrix()
    away = np.array([0.0195, 0.018, 0.03, 0.2])
    position = np.array([0, 0, 0.6]) - rotation[:, :, 0] * (0.1 + away)[:, None]
    return trimesh.creation.icosphere(subdivisions=4, radius=0.1), position, rotation


def test_sense(grasp):
    mesh, position, rotation = grasp
    sensed = sense(RayCaster(mesh, (0, 0, 0.6)), position, rotation)
    np.testing.assert_array_equal(sensed.success, [True, True, False, False])
    assert sensed.depth.dtype == np.float32 and sensed.points.dtype == np.float32
    for k in range(2):
        # Every pixel's point is its pose applied to (depth, y, z), in row-major order.
        touched = np.isfinite(sensed.depth[k])
        count = sensed.point_count[k]
        assert count == touched.sum() > 100
        local = np.stack([sensed.depth[k][touched], Y[touched], Z[touched]], axis=1)
        expected = local @ rotation[k].T + position[k]
        np.testing.assert_allclose(sensed.points[k, :count], expected, atol=1e-7)
        assert (sensed.points[k, count:] == 0).all()
        from_centre = np.linalg.norm(sensed.points[k, :count] - [0, 0, 0.6], axis=1)
        assert from_centre.min() > 0.0995 and from_centre.max() < 0.1 + 2e-5
        np.testing.assert_array_equal(sensed.reading[k], shade(sensed.depth[k]))
    for k in (2, 3):
        assert np.isinf(sensed.depth[k]).all()
        assert sensed.point_count[k] == 0 and not sensed.points[k].any() and not sensed.reading[k].any()


def test_sense_is_deterministic_and_sensors_are_independent(grasp):
    mesh, position, rotation = grasp
    first = sense(RayCaster(mesh, (0, 0, 0.6)), position, rotation)
    second = sense(RayCaster(mesh, (0, 0, 0.6)), position[::-1], rotation[::-1])
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a, b[::-1])


def test_poses_may_have_any_leading_axes(grasp):
    mesh, position, rotation = grasp
    tracer = RayCaster(mesh, (0, 0, 0.6))
    flat = sense(tracer, position, rotation)
    paired = sense(tracer, position.reshape(2, 2, 3), rotation.reshape(2, 2, 3, 3))
    for one, other in zip(flat, paired, strict=True):
        np.testing.assert_array_equal(one.reshape(2, 2, *one.shape[1:]), other)


@pytest.mark.parametrize("value", [np.nan, -np.inf])
def test_a_depth_that_is_none_is_refused(value):
    depth = np.full((100, 100), 0.02)
    depth[3, 4] = value
    with pytest.raises(ValueError, match="NaN or -inf"):
        shade(depth)
