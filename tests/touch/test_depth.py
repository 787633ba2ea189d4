"""Depth maps against closed forms, a naive ray caster, and trimesh's rays."""

import igl
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from palpate.touch import PIXEL_CENTRES, RESOLUTION, SENSOR_RANGE, SENSOR_WIDTH, RayCaster, local_points

ORIGIN, IDENTITY = np.zeros((1, 3)), np.eye(3)[None]
Y, Z = np.meshgrid(PIXEL_CENTRES, PIXEL_CENTRES)


def sheet(distance, slope_y=0.0, slope_z=0.0, half=0.02):
    """An open square in front of the sensor: x = distance + slope_y y + slope_z z."""
    y, z = np.array([-half, half, half, -half]), np.array([-half, -half, half, half])
    vertices = np.column_stack([distance + slope_y * y + slope_z * z, y, z])
    return trimesh.Trimesh(vertices, [[0, 1, 2], [0, 2, 3]], process=False)


def turned(mesh, angles, position=(0, 0, 0)):
    mesh.apply_transform(trimesh.transformations.euler_matrix(*np.deg2rad(angles)))
    mesh.apply_translation(position)
    return mesh


def lumpy(seed=0):
    """A bumpy closed surface about 0.1 m wide."""
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    random = np.random.default_rng(seed)
    mesh.vertices *= 1 + 0.1 * random.standard_normal((len(mesh.vertices), 1)).clip(-2, 2)
    return mesh


def poses_near(mesh, count, seed=0, gap=(-0.01, 0.03)):
    """Sensors that look at random spots of a mesh roughly along the normals."""
    random = np.random.default_rng(seed)
    points, face = trimesh.sample.sample_surface(mesh, count, seed=seed)
    rotation = Rotation.random(count, random_state=seed).as_matrix()
    towards = -mesh.face_normals[face] + 0.5 * random.standard_normal((count, 3))
    for frame, x in zip(rotation, towards, strict=True):
        frame[:, 0] = x / np.linalg.norm(x)
        frame[:, 1] -= frame[:, 0] * (frame[:, 0] @ frame[:, 1])
        frame[:, 1] /= np.linalg.norm(frame[:, 1])
        frame[:, 2] = np.cross(frame[:, 0], frame[:, 1])
    return points - rotation[:, :, 0] * random.uniform(*gap, (count, 1)), rotation


def distance_to(mesh, points):
    squared, _, _ = igl.point_mesh_squared_distance(
        np.asarray(points, dtype=np.float64),
        np.array(mesh.vertices, dtype=np.float64),
        np.array(mesh.faces, dtype=np.int64),
    )
    return np.sqrt(squared)


def naive_depth(mesh, position, rotation, rows, columns):
    """Every ray against every face in double precision (Moeller and Trumbore 1997)."""
    a, b, c = np.asarray(mesh.triangles).transpose(1, 0, 2)
    direction = rotation[:, 0]
    across = np.cross(direction, c - a)
    determinant = np.einsum("fi,fi->f", b - a, across)
    depth = np.full(len(rows), np.inf)
    for i, (row, column) in enumerate(zip(rows, columns, strict=True)):
        start = position + rotation @ [0, PIXEL_CENTRES[column], PIXEL_CENTRES[row]]
        u = np.einsum("fi,fi->f", start - a, across) / determinant
        q = np.cross(start - a, b - a)
        v = q @ direction / determinant
        t = np.einsum("fi,fi->f", q, c - a) / determinant
        hits = t[(u >= 0) & (v >= 0) & (u + v <= 1) & (t >= 0) & (t <= SENSOR_RANGE)]
        depth[i] = hits.min(initial=np.inf)
    return depth


def test_tilted_plane():
    depth = RayCaster(sheet(0.02, 0.2, -0.1)).trace(ORIGIN, IDENTITY)[0]
    np.testing.assert_allclose(depth, 0.02 + 0.2 * Y - 0.1 * Z, atol=1e-8)


def test_sphere():
    radius, centre = 0.012, 0.03
    mesh = turned(trimesh.creation.icosphere(subdivisions=5, radius=radius), (10, 20, 30), (centre, 0, 0))
    depth = RayCaster(mesh).trace(ORIGIN, IDENTITY)[0]
    square = radius**2 - Y**2 - Z**2
    expected = centre - np.sqrt(np.maximum(square, 0))
    # The faces lie inside the sphere, by at most the sagitta of their longest edge.
    sagitta = mesh.edges_unique_length.max() ** 2 / (8 * radius) * 1.5
    inside = (square > 0) & (expected < SENSOR_RANGE - 1e-4)
    cosine = np.sqrt(np.maximum(square, 0)) / radius
    assert np.isfinite(depth[inside]).all()
    assert (depth - expected)[inside].min() > -1e-4
    assert ((depth - expected) * cosine)[inside].max() < sagitta + 1e-5
    assert np.isinf(depth[expected > SENSOR_RANGE + 1e-4]).all()


def test_edge_of_a_box():
    width = 0.02
    mesh = turned(trimesh.creation.box((width, width, 0.1)), (0, 0, 45), (0.018 + width / np.sqrt(2), 0.001, 0))
    depth = RayCaster(mesh).trace(ORIGIN, IDENTITY)[0]
    expected = 0.018 + np.abs(Y - 0.001)
    clear = np.abs(expected - SENSOR_RANGE) > 1e-5
    expected[expected > SENSOR_RANGE] = np.inf
    np.testing.assert_allclose(depth[clear], expected[clear], atol=1e-8)


def test_agrees_with_every_ray_against_every_face():
    mesh = lumpy()
    position, rotation = poses_near(mesh, 10)
    depth = RayCaster(mesh).trace(position, rotation)
    rows, columns = np.random.default_rng(0).integers(RESOLUTION, size=(2, 300))
    for k in range(10):
        expected = naive_depth(mesh, position[k], rotation[k], rows, columns)
        np.testing.assert_allclose(depth[k, rows, columns], expected, atol=1e-6)


def test_agrees_with_the_rays_of_trimesh():
    mesh = lumpy(1)
    position, rotation = poses_near(mesh, 10, seed=1)
    depth = RayCaster(mesh).trace(position, rotation)
    plane = np.stack([np.zeros_like(Y), Y, Z], axis=-1).reshape(-1, 3)
    for k in range(10):
        start = plane @ rotation[k].T + position[k]
        place, ray, _ = mesh.ray.intersects_location(
            start, np.tile(rotation[k, :, 0], (len(start), 1)), multiple_hits=False
        )
        expected = np.full(len(start), np.inf)
        expected[ray] = (place - start[ray]) @ rotation[k, :, 0]
        expected[expected > SENSOR_RANGE] = np.inf
        # Rays that graze an edge may be decided either way.
        assert (~np.isclose(depth[k].ravel(), expected, atol=1e-6)).sum() <= 2


def test_a_hit_exactly_at_the_range_counts_and_one_beyond_does_not():
    at = RayCaster(sheet(SENSOR_RANGE)).trace(ORIGIN, IDENTITY)
    beyond = RayCaster(sheet(SENSOR_RANGE + 2e-5)).trace(ORIGIN, IDENTITY)
    assert np.isfinite(at).all()
    assert np.isinf(beyond).all()


def test_one_rounding_step_beyond_the_range_is_out():
    beyond = RayCaster(sheet(np.nextafter(SENSOR_RANGE, 1)))
    assert np.isinf(beyond.trace(ORIGIN, IDENTITY)).all()
    assert not beyond.succeeds(ORIGIN, IDENTITY).any()


def test_what_is_behind_or_beside_the_sensor_is_not_touched():
    for away in ((-0.005, 0, 0), (0.02, 0.05, 0), (0.02, 0, -0.05), (0.06, 0, 0)):
        mesh = turned(trimesh.creation.box((0.004, 0.02, 0.02)), (0, 0, 0), away)
        assert np.isinf(RayCaster(mesh).trace(ORIGIN, IDENTITY)).all()
        assert not RayCaster(mesh).succeeds(ORIGIN, IDENTITY)[0]


def test_winding_does_not_matter():
    mesh = lumpy(3)
    flipped = trimesh.Trimesh(mesh.vertices, mesh.faces[:, ::-1], process=False)
    half = trimesh.Trimesh(
        mesh.vertices, np.where(np.arange(len(mesh.faces))[:, None] % 2, mesh.faces, flipped.faces), process=False
    )
    position, rotation = poses_near(mesh, 4, seed=3)
    expected = RayCaster(mesh).trace(position, rotation)
    np.testing.assert_allclose(RayCaster(flipped).trace(position, rotation), expected, atol=1e-9)
    np.testing.assert_allclose(RayCaster(half).trace(position, rotation), expected, atol=1e-9)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10_000), thin=st.floats(1e-4, 1.0))
def test_local_points_lie_on_the_mesh(seed, thin):
    mesh = lumpy(seed % 7)
    # Slivers: flattened and stretched.
    mesh.apply_scale([1.0, thin, 2.0])
    position, rotation = poses_near(mesh, 2, seed=seed, gap=(-0.005, 0.02))
    for k, depth in enumerate(RayCaster(mesh).trace(position, rotation)):
        points = local_points(depth, position[k], rotation[k])
        if len(points):
            assert distance_to(mesh, points).max() < 5e-7


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10_000), gap=st.floats(-0.04, 0.06))
def test_omitting_sensors_without_a_near_face_changes_nothing(seed, gap):
    parts = [turned(trimesh.creation.box((0.01, 0.002, 0.03)), (20 * i, 50 * i, 0), (0.02 * i, 0, 0)) for i in range(4)]
    mesh = trimesh.util.concatenate(parts)
    position, rotation = poses_near(mesh, 1, seed=seed, gap=(gap, gap))
    tracer = RayCaster(mesh)
    everything = tracer._in_range(position[0], rotation[0])
    np.testing.assert_array_equal(tracer.trace(position, rotation)[0], everything.astype(np.float32))


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_succeeds_is_any_finite_depth(seed):
    random = np.random.default_rng(seed)
    # Few small triangles: often only a handful of pixels, or none, meet one.
    corners = random.uniform([0.0, -1, -1], [2.0, 1, 1], (4, 1, 3)) * [SENSOR_RANGE, SENSOR_WIDTH, SENSOR_WIDTH]
    corners = corners + random.normal(scale=3e-4, size=(4, 3, 3))
    mesh = trimesh.Trimesh(corners.reshape(-1, 3), np.arange(12).reshape(-1, 3), process=False)
    caster = RayCaster(mesh)
    assert caster.succeeds(ORIGIN, IDENTITY)[0] == np.isfinite(caster.trace(ORIGIN, IDENTITY)).any()


def test_moving_sensor_and_object_together_changes_nothing():
    mesh = lumpy(4)
    position, rotation = poses_near(mesh, 3, seed=4)
    shift = np.array([0, 0, 0.6])
    here = RayCaster(mesh).trace(position, rotation)
    there = RayCaster(mesh, object_position=shift).trace(position + shift, rotation)
    np.testing.assert_allclose(there, here, atol=1e-7)


def test_defects_are_ignored():
    mesh = lumpy(6)
    position, rotation = poses_near(mesh, 3, seed=6)
    expected = RayCaster(mesh).trace(position, rotation)
    stray = np.concatenate([mesh.vertices, [[np.nan] * 3, [np.inf, 0, 0], [1e9, 1e9, 1e9]]])
    n = len(mesh.vertices)
    bad = [[0, 0, 1], [2, 2, 2], [0, 1, n], [n + 1, 3, 4]]
    dirty = trimesh.Trimesh(stray, np.concatenate([bad, mesh.faces]), process=False, validate=False)
    np.testing.assert_allclose(RayCaster(dirty).trace(position, rotation), expected, atol=1e-7)


def test_a_mesh_without_area_is_refused():
    points = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]], process=False)
    with pytest.raises(ValueError, match="area"):
        RayCaster(points)


def test_rotations_may_be_in_single_precision():
    tracer = RayCaster(sheet(0.01))
    for call in (tracer.trace, tracer.succeeds):
        np.testing.assert_array_equal(call(ORIGIN, IDENTITY.astype(np.float32)), call(ORIGIN, IDENTITY))


def test_poses_that_are_none_are_errors_and_no_missed_touch():
    tracer, nan = RayCaster(sheet(0.01)), np.diag([1.0, np.nan, 1])
    poses = [((0, at, 0), np.eye(3), "position of sensor 0 is not finite") for at in (np.nan, np.inf)]
    poses += [((0, 0, 0), axes, "axes of sensor 0 are not") for axes in (nan, np.diag([1.0, 1, -1]), 1.01 * np.eye(3))]
    for position, rotation, message in poses:
        for call in (tracer.trace, tracer.succeeds):
            with pytest.raises(ValueError, match=message):
                call(np.array([position], dtype=float), rotation[None])


def test_points_too_far_out_for_single_precision_are_refused():
    depth = np.full((RESOLUTION, RESOLUTION), 0.01)
    for away in (17.0, -1e6, np.nan):
        with pytest.raises(ValueError, match="too far from the origin"):
            local_points(depth, np.array([0, away, 0]), np.eye(3))
    assert np.abs(local_points(depth, np.array([0, 16.0, 0]), np.eye(3))[0, 1] - 16 - PIXEL_CENTRES[0]) < 1e-6
