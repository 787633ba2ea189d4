"""Frames of closings: they end at the grasps, bit for bit, and lie on the way of a simulation of every step."""

from fractions import Fraction

import mujoco
import numpy as np
import pytest
import trimesh

from palpate.batch import generator
from palpate.grasp import Grasper, closing_frames, grasp_object
from palpate.grasp.frames import frame_steps
from palpate.hand import allegro
from palpate.mesh import OBJECT_POSITION
from palpate.seal import DamagedFile

HAND, COUNT = allegro(), 12
MESH = trimesh.creation.box((0.06, 0.09, 0.48)).subdivide().subdivide()
POINTS = trimesh.sample.sample_surface(MESH, 3000, seed=0)[0] + OBJECT_POSITION


def grasper():
    return Grasper(MESH, MESH, POINTS - OBJECT_POSITION, HAND)


@pytest.fixture(scope="module")
def kept():
    """Half of the attempts' grasps are kept."""
    found = grasp_object(MESH, MESH, POINTS, HAND, generator(0, "box"), per_object=3, attempts=6)
    assert found.attempts >= 6
    return vars(found)


@pytest.fixture(scope="module")
def frames(kept):
    return closing_frames(grasper(), kept, generator(0, "box"), COUNT)


def test_contacts_change_nothing_and_those_at_rest_are_of_the_closed_hand(kept, frames):
    found = closing_frames(grasper(), kept, generator(0, "box"), COUNT, with_contacts=True)
    for name, values in frames.items():
        np.testing.assert_array_equal(found[name], values)
    taken = np.arange(found["contact_force"].shape[-1]) < found["contact_count"][..., None]
    assert not found["contact_count"][:, 0].any() and found["contact_count"][:, -1].all()
    assert not found["contact_position"][~taken].any()
    # On the box's surface, from outside in, and on that of the link.
    on_object = taken & (found["contact_other"] == -1)
    places = found["contact_position"][on_object] - OBJECT_POSITION
    assert np.abs((np.abs(places) - MESH.extents / 2).max(axis=1)).max() < 0.002
    frame = np.argwhere(on_object)[:, :2]
    for place, normal, link, (grasp, moment) in zip(
        places, found["contact_normal"][on_object], found["contact_link"][on_object], frame, strict=True
    ):
        pose = found["link_pose"][grasp, moment]
        (inside,) = HAND.signed_distance((place + OBJECT_POSITION + 0.004 * normal)[None], pose, links=[link])
        assert inside < 0.0005  # along the normal lies the link


def test_the_last_frame_is_the_grasp_bit_for_bit(kept, frames):
    for name in ("joint_positions", "link_pose", "sensor_position", "sensor_rotation"):
        assert frames[name].dtype == kept[name].dtype and frames[name].shape[:2] == (3, COUNT)
        np.testing.assert_array_equal(frames[name][:, -1], kept[name])


def test_the_first_frame_is_the_open_hand_where_the_palm_stays(kept, frames):
    np.testing.assert_array_equal(frames["joint_positions"][:, 0], np.tile(HAND.open_joint_positions, (3, 1)))
    assert not frames["joint_velocities"][:, 0].any()
    assert (frames["link_pose"][:, :, 0] == kept["palm_pose"][:, None]).all()


def test_frames_are_states_of_a_simulation_of_every_step(kept, frames):
    """Stepped here: the frames are among its states, at their times, and its velocities are differences of them."""
    made = grasper()
    simulation, draw = made.simulation, generator(0, "box")
    for _ in range(kept["attempts"]):
        pose, thumb = made.placement(draw)
        number = np.flatnonzero((kept["palm_pose"][:, :3, 3] == pose[:3, 3] + OBJECT_POSITION).all(axis=1))
        if not len(number):
            continue
        targets, states = made.workspace.targets(pose, made.surface, thumb), [HAND.open_joint_positions]
        for share in simulation.ramp:
            simulation.data.ctrl[:] = states[0] + share * (targets - states[0])
            mujoco.mj_step(simulation.model, simulation.data)
            states.append(simulation.data.qpos.copy())
        (number,) = number
        steps = np.rint(frames["time"][number] / 0.004).astype(int)
        np.testing.assert_array_equal(frames["joint_positions"][number], np.array(states)[steps])
        velocities = np.diff(states, axis=0)[steps[1:] - 1] / 0.004  # the integrator moves by the new velocity
        np.testing.assert_allclose(frames["joint_velocities"][number, 1:], velocities, atol=1e-9)


def test_moments_are_evenly_in_time():
    np.testing.assert_array_equal(frame_steps(11, 100), np.arange(0, 101, 10))
    assert frame_steps(1, 100).tolist() == [100]
    assert np.ptp(np.diff(frame_steps(20, 100))) <= 1 and frame_steps(101, 100).tolist() == list(range(101))
    with pytest.raises(ValueError, match="at most 101"):
        frame_steps(102, 100)


def test_times_are_those_of_the_time_step():
    settings = {"timestep": 0.008, "thumb_share": 1.0}
    kept = vars(grasp_object(MESH, MESH, POINTS, HAND, generator(0, "box"), per_object=1, attempts=1, **settings))
    made = Grasper(MESH, MESH, POINTS - OBJECT_POSITION, HAND, **settings)
    time = closing_frames(made, kept, generator(0, "box"), 3)["time"]
    np.testing.assert_allclose(time, [[0, 0.008 * round(made.simulation.steps / 2), 0.008 * made.simulation.steps]])


@pytest.mark.parametrize(("count", "steps"), [(20, 100), (8, 375), (3, 5), (101, 150)])
def test_a_moment_is_at_the_step_nearest_to_it(count, steps):
    exact = [Fraction(steps * number, count - 1) for number in range(count)]
    assert max(abs(step - at) for step, at in zip(frame_steps(count, steps).tolist(), exact, strict=True)) <= 0.5


def test_grasps_that_closing_again_does_not_give_are_an_error(kept):
    moved = kept | {"joint_positions": kept["joint_positions"] + 1e-15}
    elsewhere = kept | {"palm_pose": kept["palm_pose"] + 1e-15}
    for other in (moved, elsewhere):
        with pytest.raises(DamagedFile, match="another kind of processor; make them again"):
            closing_frames(grasper(), other, generator(0, "box"), COUNT, "make them again")
