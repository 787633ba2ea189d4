"""The hand's kinematics against MuJoCo's, its limits, its arrays and its errors."""

from dataclasses import fields, replace

import h5py
import mujoco
import numpy as np
import pytest

from palpate.hand import Hand, allegro
from palpate.hand.model import LARGEST_INERTIA, build_spec, quaternion


def random_pose(rng):
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    rotation[:, 0] *= np.sign(np.linalg.det(rotation))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, rng.uniform(-0.5, 0.5, 3)
    return pose


@pytest.fixture(scope="module")
def hand():
    return allegro()


def test_forward_kinematics_are_those_of_mujoco(hand):
    rng = np.random.default_rng(0)
    model = build_spec(hand).compile()
    data = mujoco.MjData(model)
    for _ in range(20):
        joints, palm = rng.uniform(*hand.joint_range.T), random_pose(rng)
        model.body_pos[1], model.body_quat[1] = palm[:3, 3], quaternion(palm[:3, :3])
        data.qpos = joints
        mujoco.mj_forward(model, data)
        links = hand.forward(palm, joints)
        np.testing.assert_allclose(links[:, :3, 3], data.xpos[1:], atol=1e-12)
        np.testing.assert_allclose(links[:, :3, :3], data.xmat[1:].reshape(-1, 3, 3), atol=1e-12)
        geoms = hand.geom_poses(links)
        np.testing.assert_allclose(geoms[:, :3, 3], data.geom_xpos, atol=1e-12)


def test_forward_takes_many_poses_at_once(hand):
    rng = np.random.default_rng(1)
    palms = np.stack([random_pose(rng) for _ in range(6)]).reshape(2, 3, 4, 4)
    joints = rng.uniform(*hand.joint_range.T, (3, 16))
    together = hand.forward(palms, joints)
    assert together.shape == (2, 3, 21, 4, 4)
    np.testing.assert_allclose(together[1, 2], hand.forward(palms[1, 2], joints[2]), atol=1e-15)


def test_out_of_range_is_the_excess_of_the_worst_joint(hand):
    low, high = hand.joint_range.T
    joints = np.stack([low, high, (low + high) / 2, low, high])
    joints[3, 12] -= 0.01
    joints[4, [2, 5]] += [0.02, 0.03]
    np.testing.assert_allclose(hand.out_of_range(joints), [0, 0, 0, 0.01, 0.03], atol=1e-15)
    assert hand.out_of_range(joints[4]) == pytest.approx(0.03)


def test_limits_in_the_model_are_radians(hand):
    # With the compiler's default of degrees they would be 57 times as narrow.
    model = build_spec(hand).compile()
    assert model.nq == model.nv == model.nu == 16
    np.testing.assert_allclose(model.jnt_range, hand.joint_range)
    assert model.jnt_limited.all()
    assert hand.joint_range[1, 1] == 1.61 and hand.joint_range[12, 0] == 0.263


def test_sensors_look_out_of_the_gel_along_x(hand):
    links = hand.forward(np.eye(4), hand.open_joint_positions)
    position, rotation = hand.sensor_frames(links)
    np.testing.assert_allclose(rotation @ rotation.swapaxes(-1, -2), np.tile(np.eye(3), (4, 1, 1)), atol=1e-12)
    # The open fingers look where the palm looks.
    assert (rotation[:3, 0, 0] > 0.99).all()
    # The sensor's origin is in the DIGIT's body, its range of 25 mm ends beyond the gel's apex.
    for sensor in range(4):
        inside, apex, beyond = position[sensor] + np.array([[0.0], [0.0192], [0.0194]]) * rotation[sensor, :, 0]
        distances = hand.signed_distance(np.stack([inside, apex, beyond]), links)
        assert distances[0] < 0 and distances[1] < 0 < distances[2]


def test_the_index_finger_is_the_thumbs_neighbour(hand):
    joints = hand.open_joint_positions.copy()
    tips = hand.sensor_frames(hand.forward(np.eye(4), joints))[0]
    to_thumb = np.linalg.norm(tips[:3] - tips[3], axis=1)
    assert to_thumb[0] < to_thumb[1] < to_thumb[2]


def test_no_link_is_in_another_when_the_hand_is_open(hand):
    model = build_spec(hand).compile()
    data = mujoco.MjData(model)
    data.qpos = hand.open_joint_positions
    mujoco.mj_forward(model, data)
    assert data.ncon == 0


def test_arrays_bring_the_hand_back_through_hdf5(hand, tmp_path):
    with h5py.File(tmp_path / "hand.h5", "w") as file:
        for name, array in hand.to_arrays().items():
            file.create_dataset(f"hand/{name}", data=array)
    with h5py.File(tmp_path / "hand.h5") as file:
        again = Hand.from_arrays(file["hand"])
    for field in fields(hand):
        one, other = getattr(hand, field.name), getattr(again, field.name)
        if isinstance(one, np.ndarray):
            np.testing.assert_array_equal(one, other)
        elif not field.name.startswith("geom_v") and not field.name.startswith("geom_f"):
            assert one == other


@pytest.mark.parametrize(("kept", "message"), [(slice(0), "no touch sensor:"), (slice(3, 4), "but the thumb's")])
def test_a_hand_has_sensors_besides_the_thumbs(hand, kept, message):
    names = ("sensor_names", "sensor_thumb", "sensor_link", "sensor_position", "sensor_rotation")
    with pytest.raises(ValueError, match=message):
        replace(hand, **{name: getattr(hand, name)[kept] for name in names})


def test_joint_positions_of_the_wrong_number_are_named(hand):
    with pytest.raises(ValueError, match="expected 16 joint positions"):
        hand.forward(np.eye(4), np.zeros(12))


def resized(hand, size):
    """The hand at `size` times its lengths."""
    anchor = hand.palm_anchor.copy()
    anchor[:3, 3] *= size
    lengths = ("link_position", "geom_size", "geom_position", "sensor_position")
    return replace(hand, palm_anchor=anchor, **{name: size * getattr(hand, name) for name in lengths})


def inertia(model, joint_positions):
    """Inertia of the links about each hinge (J,), without armature, by the kinetic energy of its turning."""
    data = mujoco.MjData(model)
    energies = []
    for joint in range(model.nv):
        data.qpos[:], data.qvel[:] = joint_positions, 0
        data.qvel[joint] = 1
        mujoco.mj_forward(model, data)
        mujoco.mj_energyVel(model, data)
        energies.append(2 * data.energy[1] - model.dof_armature[joint])
    return np.array(energies)


@pytest.mark.parametrize("size", [0.1, 1, 1.5, 4])
def test_no_hinge_turns_more_than_its_servo_can_stop(hand, size):
    model = build_spec(resized(hand, size)).compile()
    found = inertia(model, hand.open_joint_positions)
    assert found.max() <= 1.02 * LARGEST_INERTIA  # the lightest a link may be adds a little
    water = 1000 * (8 * np.prod(size * hand.geom_size, axis=1)).sum()
    if size <= 1:
        assert model.body_mass.sum() == pytest.approx(water, abs=1e-3 * model.nbody)
    else:
        assert found.max() == pytest.approx(LARGEST_INERTIA, rel=0.02)
        assert model.body_mass.sum() < 0.7 * water
