"""Whole grasps: they face the surface, stay out of it, repeat, and end."""

import importlib.util
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from palpate.batch import UnusableObject, generator
from palpate.grasp import grasp_object
from palpate.grasp.closing import GraspSimulation
from palpate.grasp.grasp import BLOCKED, OUT_OF_RANGE, UNSETTLED, UNTOUCHED, Grasper
from palpate.grasp.patches import surface_patches
from palpate.grasp.penetration import PenetrationCheck
from palpate.hand import allegro, from_mjcf
from palpate.mesh import OBJECT_POSITION
from palpate.touch import RayCaster

_spec = importlib.util.spec_from_file_location("grippers", Path(__file__).parents[1] / "hand" / "grippers.py")
grippers = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(grippers)

HAND = allegro()


def bottle():
    profile = np.array([[0, -0.24], [0.07, -0.24], [0.07, 0.05], [0.025, 0.13], [0.025, 0.24], [0, 0.24]])
    return trimesh.creation.revolve(profile, sections=40)


def blade(thickness=0.0005):
    return trimesh.creation.box((0.06, 0.49, thickness))


def grasps_of(mesh, name="object", hand=HAND, **settings):
    points, _ = trimesh.sample.sample_surface(mesh, 3000, seed=0)
    return grasp_object(mesh, mesh, points + OBJECT_POSITION, hand, generator(0, name, "grasps"), **settings)


@pytest.fixture(scope="module")
def on_bottle():
    return grasps_of(bottle())


def test_arrays_are_of_one_hand_in_the_world_frame(on_bottle):
    links = HAND.forward(on_bottle.palm_pose, on_bottle.joint_positions)
    np.testing.assert_allclose(on_bottle.link_pose, links, atol=1e-12)
    position, rotation = HAND.sensor_frames(links)
    np.testing.assert_allclose(on_bottle.sensor_position, position, atol=1e-12)
    np.testing.assert_allclose(on_bottle.sensor_rotation, rotation, atol=1e-12)
    assert np.linalg.norm(on_bottle.palm_pose[:, :3, 3] - OBJECT_POSITION, axis=1).max() < 0.5
    assert on_bottle.touches.shape == (5, 4) and on_bottle.touches.any(axis=1).all()
    assert on_bottle.attempts == 5 + sum(on_bottle.discarded.values())


def test_touches_are_what_the_rays_will_find(on_bottle):
    caster = RayCaster(bottle(), OBJECT_POSITION)
    depth = [
        caster.trace(position, rotation)
        for position, rotation in zip(on_bottle.sensor_position, on_bottle.sensor_rotation, strict=True)
    ]
    np.testing.assert_array_equal(np.isfinite(depth).any(axis=(2, 3)), on_bottle.touches)


def test_sensors_that_touch_face_the_surface(on_bottle):
    mesh = bottle()
    position = on_bottle.sensor_position[on_bottle.touches] - OBJECT_POSITION
    looks = on_bottle.sensor_rotation[on_bottle.touches][:, :, 0]
    face = mesh.ray.intersects_first(position, looks)
    hit = face >= 0
    assert hit.mean() > 0.7
    angle = np.degrees(np.arccos(np.clip(-(mesh.face_normals[face] * looks).sum(axis=1)[hit], -1, 1)))
    assert np.median(angle) < 30 and angle.max() < 90


def test_penetration_is_small_and_independently_so(on_bottle):
    """Against the points of a dense sample of the whole surface."""
    points, _ = trimesh.sample.sample_surface(bottle(), 100_000, seed=3)
    for links, depth in zip(on_bottle.link_pose, on_bottle.penetration, strict=True):
        sampled = max(0.0, -HAND.signed_distance(points + OBJECT_POSITION, links).min())
        assert sampled <= depth + 5e-4  # the check's resolution
        assert depth <= 0.001


def test_a_grasp_depends_on_seed_and_name_alone(on_bottle):
    different = grasps_of(bottle(), "bottle-2")
    again = grasps_of(bottle())
    np.testing.assert_array_equal(on_bottle.joint_positions, again.joint_positions)
    np.testing.assert_array_equal(on_bottle.palm_pose, again.palm_pose)
    assert np.abs(different.palm_pose - on_bottle.palm_pose).max() > 0.01


def test_grasps_do_not_depend_on_the_number_of_threads():
    """In processes of their own, for the number of threads is fixed when numpy is loaded."""
    script = """
import sys, numpy as np, trimesh
from palpate.batch import generator
from palpate.grasp import grasp_object
from palpate.hand import allegro
mesh = trimesh.creation.cylinder(radius=0.04, height=0.4)
points = trimesh.sample.sample_surface(mesh, 2000, seed=0)[0] + (0, 0, 0.6)
found = grasp_object(mesh, mesh, points, allegro(), generator(0, "rod"), per_object=3, attempts=3)
sys.stdout.buffer.write(found.joint_positions.tobytes() + found.penetration.tobytes())
"""
    outputs = []
    for threads in "12":
        environment = os.environ | {f"{library}_NUM_THREADS": threads for library in ("OMP", "OPENBLAS")}
        run = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, check=True)
        outputs.append(run.stdout)
    assert len(outputs[0]) == 3 * (16 * 8 + 4) and outputs[0] == outputs[1]


def test_attempts_in_one_simulation_do_not_remember_each_other():
    mesh = bottle()
    points, _ = trimesh.sample.sample_surface(mesh, 3000, seed=0)
    fresh = Grasper(mesh, mesh, points, HAND).attempt(generator(8, "b"))
    used = Grasper(mesh, mesh, points, HAND)
    for number in range(3):
        used.attempt(generator(number, "a"))
    np.testing.assert_array_equal(used.attempt(generator(8, "b")).joint_positions, fresh.joint_positions)


def test_more_attempts_keep_better_grasps():
    few, many = grasps_of(bottle(), thumb_share=0.5), grasps_of(bottle(), thumb_share=0.5, attempts=15)
    assert many.touches.sum() > few.touches.sum()
    counts = many.touches.sum(axis=1)
    assert (np.diff(counts) <= 0).all()
    assert many.attempts >= 15


def test_an_object_that_gives_too_few_grasps_is_unusable_with_the_reason():
    # Nothing of 2 mm can be touched with the palm 5 mm away or more, but by chance.
    crumb = trimesh.creation.icosphere(subdivisions=2, radius=0.001)
    with pytest.raises(UnusableObject, match=r"of 5 grasps found in 8 attempts .*no sensor touches: \d"):
        grasps_of(crumb, max_attempts=8)
    with pytest.raises(UnusableObject, match="found in 3 attempts"):
        grasps_of(bottle(), max_attempts=3)


def test_an_object_without_a_surface_is_unusable():
    hair = trimesh.Trimesh([[-0.25, 0, 0], [0.25, 0, 0], [0, 1e-9, 0]], [[0, 1, 2]], process=False)
    with pytest.raises(UnusableObject, match="no surface that a finger could stop at"):
        grasp_object(hair, hair, np.tile(OBJECT_POSITION, (9, 1)), HAND, generator(0, "hair"))


def test_no_grasp_above_the_allowed_penetration_is_kept():
    with pytest.raises(UnusableObject, match="penetrates too deep: [1-9]"):
        grasps_of(bottle(), max_penetration=-1.0, max_attempts=6)


def test_fewer_attempts_than_grasps_is_an_error():
    with pytest.raises(ValueError, match=r"attempts \(3\) must be at least per_object \(5\)"):
        grasps_of(bottle(), attempts=3)


def test_surface_points_in_the_wrong_frame_are_an_error():
    mesh = bottle()
    points, _ = trimesh.sample.sample_surface(mesh, 300, seed=0)
    with pytest.raises(ValueError, match="world frame"):
        grasp_object(mesh, mesh, points, HAND, generator(0, "a"))


@pytest.mark.parametrize("thickness", [0.0005, 0.002])
def test_a_thin_blade_is_grasped_without_nan(thickness):
    found = grasps_of(blade(thickness))
    assert np.isfinite(found.joint_positions).all()
    assert found.penetration.max() <= 0.001
    assert found.discarded.get("simulation warned or gave NaN", 0) == 0


def test_an_open_mesh_and_a_soup_are_grasped():
    soup = bottle()
    rng = np.random.default_rng(0)
    soup.update_faces(rng.random(len(soup.faces)) < 0.95)
    soup = trimesh.Trimesh(soup.triangles.reshape(-1, 3), np.arange(3 * len(soup.faces)).reshape(-1, 3), process=False)
    assert not soup.is_watertight
    assert grasps_of(soup).touches.any(axis=1).all()


def test_a_silent_reset_of_the_engine_is_noticed():
    """The engine answers a NaN by resetting the state: only its warnings tell."""
    simulation = GraspSimulation(HAND, surface_patches(bottle()))
    pose = np.eye(4)
    pose[:3, 3] = (-0.4, 0, 0)
    simulation.place(pose, HAND.open_joint_positions)
    closed = simulation.close(np.full(16, np.nan))
    assert not closed.finite and np.isfinite(closed.joint_positions).all()
    simulation.place(pose, HAND.open_joint_positions)
    assert simulation.close(HAND.open_joint_positions).finite


def test_fingers_stop_at_the_surface_where_they_would_pass_it():
    """A wall 20 mm in front of the palm: targets behind it are not reached, and nothing is in the wall."""
    wall = trimesh.creation.box((0.02, 0.3, 0.3))
    wall.apply_translation((0.0313 + 0.01, 0, 0.17))  # above the thumb
    simulation = GraspSimulation(HAND, surface_patches(wall))
    simulation.place(np.eye(4), HAND.open_joint_positions)
    assert not simulation.in_contact()
    targets = HAND.open_joint_positions.copy()
    targets[[1, 5, 9]] = 0.8
    closed = simulation.close(targets)
    assert closed.finite
    assert (closed.joint_positions[[1, 5, 9]] < 0.4).all()
    links = HAND.forward(np.eye(4), closed.joint_positions)
    assert PenetrationCheck(HAND, wall).in_object(links) < 0.0005


def test_without_an_object_the_joints_reach_their_targets():
    simulation = GraspSimulation(HAND, [])
    simulation.place(np.eye(4), HAND.open_joint_positions)
    targets = HAND.open_joint_positions + 0.2
    np.testing.assert_allclose(simulation.close(targets).joint_positions, targets, atol=0.02)


def test_a_users_hand_grasps_end_to_end(tmp_path):
    (tmp_path / "gripper.xml").write_text(grippers.two_fingers("degree"))
    hand = from_mjcf(tmp_path / "gripper.xml", grippers.SENSORS)
    found = grasps_of(bottle(), hand=hand, thumb_share=1.0)
    assert found.joint_positions.shape == (5, 5) and found.touches.any(axis=1).all()


@pytest.mark.parametrize("timestep", [0.0, -0.004, float("nan"), 1e-9, 0.011])
def test_time_steps_that_cannot_work_are_errors(timestep):
    with pytest.raises(ValueError, match="time step of .* is not between"):
        GraspSimulation(HAND, surface_patches(blade(0.02)), timestep)


def fist(deep):
    """A hand whose index and middle finger are in each other when it is open, or bent side by side."""
    joints = HAND.open_joint_positions.copy()
    joints[[1, 5]] = 1.2
    if deep:
        joints[[0, 4]] = 0.25, -0.25
    return replace(HAND, open_joint_positions=joints)


def test_a_hand_that_is_in_itself_when_open_is_an_error_and_not_one_of_the_object():
    with pytest.raises(
        ValueError, match="hand 'allegro': open, its links 'index_tip' and 'middle_tip' are 1.* mm deep in each other"
    ):
        grasps_of(bottle(), hand=fist(deep=True))
    assert len(grasps_of(bottle(), hand=fist(deep=False), per_object=1, attempts=1).touches) == 1


def test_gaps_that_no_palm_fits_in_leave_no_free_pose():
    """Parallel sheets 15 mm apart that face upwards, and points on the lowest."""
    sheet = trimesh.Trimesh(0.15 * np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]), [(0, 1, 2), (0, 2, 3)])
    sheets = trimesh.util.concatenate([sheet.copy().apply_translation((0, 0, 0.015 * k)) for k in range(8)])
    points = np.random.default_rng(0).uniform(-0.02, 0.02, (100, 3)) * (1, 1, 0)
    assert Grasper(sheets, sheets, points, HAND).attempt(np.random.default_rng(0)) == BLOCKED


def test_a_pose_is_free_of_the_object_though_the_hand_touches_itself():
    simulation = GraspSimulation(fist(deep=True), surface_patches(blade(0.02)))
    far, near = np.eye(4), np.eye(4)
    far[0, 3], near[:3, 3] = 2.0, (-0.05, 0, -0.05)
    simulation.place(far, simulation.hand.open_joint_positions)
    assert simulation.data.ncon > 0 and not simulation.in_contact()
    simulation.place(near, simulation.hand.open_joint_positions)
    assert simulation.in_contact()


def test_a_hand_that_swings_is_not_settled_and_its_attempt_is_none():
    points, _ = trimesh.sample.sample_surface(bottle(), 500, seed=0)
    grasper = Grasper(bottle(), bottle(), points, HAND)
    simulation, targets = grasper.simulation, HAND.open_joint_positions.copy()
    targets[[1, 5, 9]] = 1.0
    away = np.eye(4)
    away[0, 3] = 2.0
    simulation.place(away, HAND.open_joint_positions)
    assert simulation.close(targets).settled
    simulation.place(away, HAND.open_joint_positions)
    assert simulation.close(HAND.open_joint_positions).settled
    simulation.model.dof_armature[:] = 0.05  # a hundred times as slow to stop
    simulation.place(away, HAND.open_joint_positions)
    closed = simulation.close(targets)
    assert closed.finite and not closed.settled
    assert grasper.attempt(np.random.default_rng(0)) == UNSETTLED


def test_a_grasp_with_a_joint_pushed_out_of_its_range_is_none():
    points, _ = trimesh.sample.sample_surface(bottle(), 500, seed=0)
    grasper = Grasper(bottle(), bottle(), points, HAND)
    simulation, targets = grasper.simulation, HAND.open_joint_positions.copy()
    targets[12] = HAND.joint_range[12, 0] - 0.3  # the servo pushes the thumb against its lower limit
    away = np.eye(4)
    away[0, 3] = 2.0
    simulation.place(away, HAND.open_joint_positions)
    assert grasper.closed_at(away, targets) == UNTOUCHED  # the limit is stiff
    simulation.model.jnt_solimp[:, :2] = 0.01
    simulation.place(away, HAND.open_joint_positions)
    assert grasper.closed_at(away, targets) == OUT_OF_RANGE
