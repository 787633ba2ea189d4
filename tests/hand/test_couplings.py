"""Joints that move together, against MuJoCo's own simulation of the user's model."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh

from palpate.configuration import ConfigError
from palpate.grasp import grasp_object
from palpate.grasp.closing import GraspSimulation
from palpate.grasp.targets import DIRECTION_LENGTH, Workspace
from palpate.hand import from_mjcf
from palpate.hand.couplings import TOLERANCE
from palpate.hand.model import build_spec
from palpate.mesh import OBJECT_POSITION

CASES = Path(__file__).parents[1] / "cases"
JAWS, BARS = CASES / "hand-equality", CASES / "hand-connect"
SENSORS = {"sensors": [{"body": "tip"}]}
# A palm with a driven finger of hinges `a`, `b` and `c`, the last one of the link `tip`.
FINGER = """<mujoco><compiler angle="radian" autolimits="true"/><worldbody><body name="palm">
<geom type="box" size=".02 .03 .03"/><body name="one" pos="0 0 .05"><joint name="a" axis="0 1 0" range="-.2 1.2"/>
<geom type="capsule" size=".006" fromto="0 0 0 0 0 .04"/><body name="two" pos="0 0 .05">
<joint name="b" axis="0 1 0" range="-1 2" ref=".1"/><geom type="capsule" size=".006" fromto="0 0 0 0 0 .03"/>
<body name="tip" pos="0 0 .04"><joint name="c" axis="0 1 0" range="-2 3"/><geom type="sphere" size=".008"/>
</body></body></body></body></worldbody>{}</mujoco>"""


def finger(folder, more, **replaced):
    text = FINGER.format(more)
    for old, new in replaced.items():
        text = text.replace(f'name="{old}"', f'name="{old}" {new}')
    (folder / "finger.xml").write_text(text)
    return from_mjcf(folder / "finger.xml", SENSORS)


def violated(path, joint_positions):
    """By how much MuJoCo says that the model's own equalities are violated, rad or m; its joints are the hand's."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    data.qpos[:] = joint_positions
    mujoco.mj_fwdPosition(model, data)
    return np.abs(data.efc_pos[data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY]).max()


def grasps_of(mesh, hand, **settings):
    points, _ = trimesh.sample.sample_surface(mesh, 3000, seed=0)
    return grasp_object(mesh, mesh, points + OBJECT_POSITION, hand, np.random.default_rng(0), **settings)


def test_jaws_coupled_by_an_equality_have_one_servo_and_stop_together():
    sensors = {"anchor": "face", "open": {"r": 0.04}, "sensors": [{"site": "l_gel"}, {"site": "r_gel"}]}
    hand = from_mjcf(JAWS / "hand.xml", sensors)
    assert hand.joint_names == ("l", "r") and hand.joint_driver.tolist() == [1, 1] and hand.drivers.tolist() == [1]
    assert hand.open_joint_positions.tolist() == [0.04, 0.04]
    assert build_spec(hand).compile().nu == 1
    aside = trimesh.creation.box((0.02, 0.02, 0.02))  # nearer to one jaw than to the other
    aside.apply_translation([0.06, 0.015, 0])
    simulation = GraspSimulation(hand, [aside.vertices])
    simulation.place(np.eye(4), hand.open_joint_positions)
    closed = simulation.close(np.zeros(2))
    # The upper jaw's face is at y = joint + 2 mm: at 25 mm it touches, and the other stops with it, in the air.
    np.testing.assert_allclose(closed.joint_positions, 0.023, atol=0.0005)
    assert abs(np.diff(closed.joint_positions)) < TOLERANCE and closed.settled


def test_grasps_of_coupled_hands_violate_no_equality_of_the_model():
    ball = trimesh.creation.icosphere(3, 0.012)
    for folder, anchor in ((JAWS, "face"), (BARS, {"body": "palm", "position": [0.01, 0, 0.09]})):
        sites = [{"site": "l_gel"}, {"site": "r_gel"}]
        given = {"anchor": anchor, "sensors": sites} | ({"open": {"r": 0.04}} if folder == JAWS else {})
        hand = from_mjcf(folder / "hand.xml", given)
        grasps = grasps_of(ball, hand, per_object=2, attempts=2)
        for positions in grasps.joint_positions:
            assert violated(folder / "hand.xml", positions) < 2 * TOLERANCE
            assert np.abs(hand.follow(positions) - positions).max() < TOLERANCE


def test_a_closed_loop_keeps_closed_as_mujoco_simulates_it():
    """A free body of the model, pushed at the crank, against where the polynomials put its joints."""
    hand = from_mjcf(BARS / "hand.xml", BARS / "sensors.yaml")
    assert [hand.joint_names[driver] for driver in hand.joint_driver] == ["l_crank"] * 3 + ["r_crank"] * 3
    np.testing.assert_allclose(hand.joint_coupling[:3, :2], [[0, 1], [0, -1], [0, 1]], atol=1e-6)  # a parallelogram
    model = mujoco.MjModel.from_xml_path(str(BARS / "hand.xml"))
    data = mujoco.MjData(model)
    model.opt.gravity[:], model.dof_damping[:], model.eq_solref[:, 0] = 0, 1e-3, 0.005
    for push in (2e-4, 4e-4):
        data.qfrc_applied[:] = [push, 0, 0, 1.5 * push, 0, 0]
        mujoco.mj_step(model, data, 800)
        assert 0.05 < data.qpos[0] < 0.8
        np.testing.assert_allclose(hand.follow(data.qpos), data.qpos, atol=2e-3)
        assert violated(BARS / "hand.xml", hand.follow(data.qpos)) < TOLERANCE


def test_a_loop_of_unequal_bars_is_a_polynomial_within_the_tolerance(tmp_path):
    text, anchor = (BARS / "hand.xml").read_text(), 'body1="l_rod" body2="l_tip" anchor="0 0 0.05"'
    assert anchor in text
    text = text.replace(anchor, anchor.replace("0.05", "0.035"))
    (tmp_path / "hand.xml").write_text(text)
    hand = from_mjcf(tmp_path / "hand.xml", BARS / "sensors.yaml")
    assert np.abs(hand.joint_coupling[:3, 2:]).max() > 1e-3
    low, high = hand.joint_range[0]
    assert high - low > 0.5
    for share in np.linspace(0, 1, 37):
        positions = hand.follow(low + share * (hand.joint_range[:, 1] - low))
        assert violated(tmp_path / "hand.xml", positions) < TOLERANCE


def test_polynomials_references_and_chains_are_those_of_the_file(tmp_path):
    """b = 0.1 + 0.2 + 1.5 a + 0.3 a^2, for its reference is 0.1; c = 0.5 (b - 0.1), through b."""
    hand = finger(
        tmp_path,
        '<equality><joint joint1="b" joint2="a" polycoef=".2 1.5 .3 0 0"/>'
        '<joint joint1="c" joint2="b" polycoef="0 .5 0 0 0"/></equality>',
    )
    assert hand.joint_driver.tolist() == [0, 0, 0]
    np.testing.assert_allclose(hand.joint_coupling[1], [0.3, 1.5, 0.3, 0, 0], atol=1e-6)
    np.testing.assert_allclose(hand.joint_coupling[2], [0.1, 0.75, 0.15, 0, 0], atol=1e-6)
    # b may go to 2: a to 0.95..., a fortieth of its range at most before
    end = (-1.5 + np.sqrt(1.5**2 + 4 * 0.3 * 1.7)) / 0.6
    assert end - 1.4 / 40 < hand.joint_range[0, 1] <= end + 1e-9
    for positions in np.random.default_rng(0).uniform(*hand.joint_range.T, (5, 3)):
        assert violated(tmp_path / "finger.xml", hand.follow(positions)) < 1e-6


@pytest.mark.parametrize(("coefficients", "expected"), [((1, 1), 1.0), ((0.5, -1), -2.0)])
def test_an_actuated_tendon_moves_its_joints_in_proportion_to_its_coefficients(tmp_path, coefficients, expected):
    """As a motor on the tendon would, were the joints equally stiff."""
    one, other = coefficients
    more = (
        f'<tendon><fixed name="t"><joint joint="b" coef="{one}"/><joint joint="c" coef="{other}"/></fixed></tendon>'
        '<actuator>{}<position joint="a"/></actuator>'
    )
    assert finger(tmp_path, more.format("")).joint_driver.tolist() == [0, 1, 2]
    hand = finger(tmp_path, more.format('<motor tendon="t"/>'))
    assert hand.joint_driver.tolist() == [0, 1, 1]
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "finger.xml"))
    model.jnt_stiffness[:], model.dof_damping[:], model.opt.gravity[:] = 0.1, 0.02, 0
    model.qpos_spring[:] = model.qpos0
    model.opt.disableflags = mujoco.mjtDisableBit.mjDSBL_CONTACT
    data = mujoco.MjData(model)
    data.ctrl[0] = 0.03
    mujoco.mj_step(model, data, 5000)
    moved = data.qpos - model.qpos0
    assert moved[2] / moved[1] == pytest.approx(expected, rel=0.02)
    np.testing.assert_allclose(hand.follow(data.qpos), data.qpos, atol=0.01)


def test_a_mimic_joint_of_a_urdf_follows(tmp_path):
    text = (CASES / "hand-urdf-root/hand.urdf").read_text()
    mimic = '<joint name="a_j2" type="revolute"><mimic joint="a_j1" multiplier="0.5" offset="0.1"/>'
    (tmp_path / "hand.urdf").write_text(text.replace('<joint name="a_j2" type="revolute">', mimic))
    hand = from_mjcf(tmp_path / "hand.urdf", CASES / "hand-urdf-root/sensors.yaml")
    assert hand.joint_names == ("a_j1", "a_j2", "b_j1", "b_j2") and hand.joint_driver.tolist() == [0, 0, 2, 3]
    np.testing.assert_allclose(hand.joint_coupling[1], [0.1, 0.5, 0, 0, 0], atol=1e-9)
    assert hand.open_joint_positions.tolist() == [0, 0.1, 0, 0]


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ('<equality><joint joint1="b"/></equality>', "equality/joint 0 fixes joint 'b': delete both"),
        (
            '<equality><joint joint1="b" joint2="a" polycoef="5 1 0 0 0"/></equality>',
            "equality/joint 0, of joints 'a', 'b', can't be kept while 'a' moves from its ref.*: off by up to 4.3 rad",
        ),
    ],
)
def test_what_one_servo_cannot_move_is_named_with_a_remedy(tmp_path, more, message):
    with pytest.raises(ConfigError, match=f"finger.xml: {message}"):
        finger(tmp_path, more)


def test_jaws_that_are_welded_to_each_other_are_named_and_a_tendon_equality_couples(tmp_path):
    text = (JAWS / "hand.xml").read_text()
    old = '<equality><joint joint1="l" joint2="r"/></equality>'
    (tmp_path / "hand.xml").write_text(text.replace(old, '<equality><weld body1="l" body2="r"/></equality>'))
    with pytest.raises(ConfigError, match="equality/weld 0, of joints 'l', 'r', can't be kept while 'l' moves"):
        from_mjcf(tmp_path / "hand.xml", JAWS / "sensors.yaml")
    tendon = '<tendon><fixed name="t"><joint joint="l" coef="1"/><joint joint="r" coef="-1"/></fixed></tendon>'
    equality = '<equality><tendon tendon1="t"/></equality>'
    (tmp_path / "hand.xml").write_text(text.replace(old, tendon + equality))
    hand = from_mjcf(tmp_path / "hand.xml", JAWS / "sensors.yaml")
    assert hand.joint_driver.tolist() == [0, 0]
    np.testing.assert_allclose(hand.joint_coupling[1], [0, 1, 0, 0, 0], atol=1e-9)


def test_a_loop_through_what_is_not_the_hand_is_named(tmp_path):
    finger(tmp_path, '<equality><connect name="bolt" body1="tip" body2="palm" anchor="0 0 0"/></equality>')
    with pytest.raises(
        ConfigError, match="finger.xml: equality/connect bolt ties the hand to what is not below its palm"
    ):
        from_mjcf(tmp_path / "finger.xml", SENSORS | {"palm": "one"})


def test_a_mechanism_that_needs_two_servos_is_named(tmp_path):
    """A fourth hinge in the loop leaves two freedoms, as its two actuators say; a single one's springs decide."""
    rod = '<geom type="capsule" size="0.003" fromto="0 0 0 0 0 0.05" contype="0" conaffinity="0"/>'
    extra = f'{rod}<body name="extra" pos="0 0 0.03"><joint name="extra" axis="1 0 0" range="-0.5 0.5"/>{rod}</body>'
    text = (BARS / "hand.xml").read_text().replace(rod, extra, 1)
    text = text.replace('body1="l_rod" body2="l_tip" anchor="0 0 0.05"', 'body1="extra" body2="l_tip" anchor="0 0 .02"')
    motors = '<actuator><motor joint="extra"/>{}</actuator></mujoco>'
    (tmp_path / "one.xml").write_text(text.replace("</mujoco>", motors.format("")))
    (tmp_path / "two.xml").write_text(text.replace("</mujoco>", motors.format('<motor joint="l_tip"/>')))
    hand = from_mjcf(tmp_path / "one.xml", BARS / "sensors.yaml")
    assert hand.joint_names[hand.joint_driver[0]] == "extra"
    for share in (0.2, 0.9):
        positions = hand.joint_range[:, 0] + share * np.ptp(hand.joint_range, axis=1)
        assert violated(tmp_path / "one.xml", hand.follow(positions)) < TOLERANCE
    with pytest.raises(ConfigError, match="two.xml: equality/connect 0, of joints .* needs the servos of 2 actuators"):
        from_mjcf(tmp_path / "two.xml", BARS / "sensors.yaml")


def test_an_equality_that_is_not_active_plays_no_part(tmp_path):
    hand = finger(tmp_path, '<equality><joint joint1="b" joint2="a" active="false"/></equality>')
    assert hand.joint_driver.tolist() == [0, 1, 2]


def test_inverse_kinematics_move_drivers_and_what_follows_them(tmp_path):
    hand = finger(tmp_path, '<equality><joint joint1="c" joint2="b" polycoef="0 1 .5 0 0"/></equality>')
    workspace = Workspace(hand)
    np.testing.assert_allclose(hand.follow(workspace.configurations), workspace.configurations)
    joints, step = hand.follow(np.array([0.3, 0.5, 0])), 1e-6
    goal = np.zeros((1, 3))
    _, jacobian = workspace.linearised(joints, goal, goal)
    assert (jacobian[..., 2] == 0).all()
    for joint in (0, 1):
        ends = []
        for sign in (1, -1):
            moved = joints.copy()
            moved[joint] += sign * step
            apex, direction = workspace.apex(hand.forward(np.eye(4), hand.follow(moved)))
            ends.append(np.concatenate([apex, DIRECTION_LENGTH * direction], axis=-1))
        np.testing.assert_allclose(jacobian[:, :, joint], (ends[0] - ends[1]) / (2 * step), atol=1e-7)
    wanted = workspace.apex(hand.forward(np.eye(4), hand.follow(np.array([0.6, 0.9, 0]))))
    solved, miss = workspace.solve(joints, *wanted)
    np.testing.assert_allclose(hand.follow(solved), solved)
    assert miss[0] < 1e-3
