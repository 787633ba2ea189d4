"""Inverse kinematics against forward kinematics, and targets on surfaces that every finger can reach."""

import numpy as np
import pytest
import trimesh

from palpate.grasp.targets import (
    DIRECTION_LENGTH,
    GAP,
    PRESS,
    Surface,
    Workspace,
    palm_pose,
    sensor_joints,
    solve_positive_definite,
)
from palpate.hand import allegro


def surface_of(mesh, count, seed):
    """Random points of a mesh with the normals of their faces."""
    points, faces = trimesh.sample.sample_surface(mesh, count, seed=seed)
    return Surface(points, mesh.face_normals[faces])


@pytest.fixture(scope="module")
def workspace():
    return Workspace(allegro())


def test_gels_are_where_the_facts_say(workspace):
    # The pad's face is at x = 0.0182 of the tip, the sensor's origin at x = -0.001073.
    np.testing.assert_allclose(workspace.hand.contact_distance(), 0.019273, atol=1e-4)


def test_each_sensor_has_its_own_four_joints(workspace):
    expected = np.kron(np.eye(4, dtype=bool), np.ones(4, dtype=bool)).astype(bool)
    np.testing.assert_array_equal(sensor_joints(workspace.hand), expected)


def test_jacobian_is_the_derivative(workspace):
    hand = workspace.hand
    joints = np.random.default_rng(1).uniform(*hand.joint_range.T)
    pose = hand.forward(np.eye(4), joints)
    found = workspace.jacobian(pose, *workspace.apex(pose))
    step = 1e-6
    for joint in range(16):
        ends = []
        for sign in (1, -1):
            moved = joints.copy()
            moved[joint] += sign * step
            apex, direction = workspace.apex(hand.forward(np.eye(4), moved))
            ends.append(np.concatenate([apex, DIRECTION_LENGTH * direction], axis=-1))
        np.testing.assert_allclose(found[:, :, joint], (ends[0] - ends[1]) / (2 * step), atol=1e-8)


def test_elimination_solves_what_lapack_solves():
    rng = np.random.default_rng(4)
    factors = rng.normal(size=(50, 4, 6, 16))
    matrix = factors @ factors.swapaxes(-1, -2) + 1e-3 * np.eye(6)
    right = rng.normal(size=(50, 4, 6))
    np.testing.assert_allclose(
        solve_positive_definite(matrix, right), np.linalg.solve(matrix, right[..., None])[..., 0], rtol=1e-8, atol=1e-12
    )


def test_inverse_kinematics_finds_back_what_forward_kinematics_made(workspace):
    hand, rng = workspace.hand, np.random.default_rng(2)
    low, high = hand.joint_range.T
    joints = rng.uniform(low + 0.1, high - 0.1, (40, 16))
    goal, inward = workspace.apex(hand.forward(np.eye(4), joints))
    start = np.clip(joints + rng.normal(scale=0.1, size=joints.shape), low, high)
    found, miss = workspace.solve(start, goal, inward)
    assert (found >= low).all() and (found <= high).all()
    # Metres, the direction's error included.
    assert np.median(miss) < 2e-4 and np.percentile(miss, 90) < 3e-3
    reached, _ = workspace.apex(hand.forward(np.eye(4), found))
    assert (np.linalg.norm(reached - goal, axis=-1) <= miss + 1e-12).all()


def test_targets_press_into_a_wall_that_all_fingers_reach(workspace):
    hand = workspace.hand
    y, z = np.meshgrid(np.linspace(-0.15, 0.15, 40), np.linspace(-0.1, 0.25, 40))
    points = np.column_stack([np.full(y.size, 0.045), y.ravel(), z.ravel()])
    wall = Surface(points, np.tile([-1.0, 0, 0], (len(points), 1)))
    targets = workspace.targets(np.eye(4), wall, thumb=False)
    apex, direction = workspace.apex(hand.forward(np.eye(4), targets))
    np.testing.assert_allclose(apex[:3, 0], 0.045 + PRESS, atol=0.003)
    assert (direction[:3, 0] > np.cos(np.radians(15))).all()
    np.testing.assert_array_equal(targets[12:], hand.open_joint_positions[12:])


def test_targets_move_with_palm_and_surface(workspace):
    # No symmetry: of two equally good points the rounding would decide.
    egg = trimesh.creation.icosphere(subdivisions=4, radius=0.06)
    egg.apply_transform(trimesh.transformations.rotation_matrix(0.4, (3, 1, 2)))
    egg.apply_scale((1.0, 1.3, 0.8))
    surface = surface_of(egg, 2000, seed=1)
    pose = np.eye(4)
    pose[:3, 3] = (-0.1, 0, -0.05)
    turn = trimesh.transformations.rotation_matrix(1.1, (1, 2, 3), (0.2, 0, 0.1))
    moved = Surface(surface.points @ turn[:3, :3].T + turn[:3, 3], surface.normals @ turn[:3, :3].T)
    one, other = workspace.targets(pose, surface), workspace.targets(turn @ pose, moved)
    np.testing.assert_allclose(one, other, atol=1e-9)


def test_the_palm_faces_the_surface_at_a_gap(workspace):
    hand, rng = workspace.hand, np.random.default_rng(5)
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.2)
    surface = surface_of(mesh, 300, seed=0)
    gaps, turns = [], []
    for _ in range(300):
        pose = palm_pose(hand, surface, rng)
        np.testing.assert_allclose(pose[:3, :3].T @ pose[:3, :3], np.eye(3), atol=1e-12)
        assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)
        anchor = pose @ hand.palm_anchor
        ahead = surface.points - anchor[:3, 3]
        along = ahead @ anchor[:3, 0]
        aside = np.linalg.norm(ahead - along[:, None] * anchor[:3, 0], axis=1)
        under = aside.argmin()
        assert aside[under] < 1e-9
        assert surface.normals[under] @ anchor[:3, 0] == pytest.approx(-1)
        gaps.append(along[under])
        turns.append(anchor[2, 2])
    assert GAP[0] <= min(gaps) and max(gaps) <= GAP[1]
    # Uniform gap, any turn.
    assert np.mean(gaps) == pytest.approx(np.mean(GAP), abs=0.004)
    assert min(turns) < -0.5 and max(turns) > 0.5
