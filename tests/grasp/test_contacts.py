"""Contact forces: those of a jaw's servo in closed form, balance with the servos' torques, action and reaction."""

import mujoco
import numpy as np
import pytest
import trimesh

from palpate.grasp.closing import GraspSimulation
from palpate.grasp.contacts import OBJECT, SLOTS, Contacts, contact_arrays, contacts, sensor_wrenches
from palpate.grasp.patches import surface_patches
from palpate.hand import allegro, from_mjcf
from palpate.hand.model import ARM, ARMATURE, DAMPING, MAX_TORQUE, STIFFNESS

TIP = 0.01  # m, radius of the jaw's tip
JAW = f"""
<mujoco>
  <worldbody>
    <body name="palm">
      <geom type="box" size=".04 .04 .01" pos="0 0 -.05"/>
      <body name="jaw">
        <joint name="jaw" type="slide" axis="0 0 1" range="0 .2"/>
        <geom type="sphere" size="{TIP}"/>
        <site name="tip" pos="0 0 {TIP}" xyaxes="0 0 1 0 1 0"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
HELD = 3.0  # s: long enough for a hand to come to rest


@pytest.fixture(scope="module")
def jaw(tmp_path_factory):
    """A jaw with a spherical tip, which slides up from the origin; its sensor looks up."""
    path = tmp_path_factory.mktemp("jaw") / "jaw.xml"
    path.write_text(JAW)
    return from_mjcf(path, {"open": [0], "sensors": [{"site": "tip"}]})


def pressed(jaw, solid, target, stiffness=STIFFNESS):
    """The simulation of a jaw that has come to rest at a convex solid."""
    simulation = GraspSimulation(jaw, [np.asarray(solid.vertices)], 0.002, HELD, stiffness)
    simulation.place(np.eye(4), jaw.open_joint_positions)
    assert simulation.close(np.array([target])).settled
    return simulation


def ball(height):
    return trimesh.creation.icosphere(subdivisions=3, radius=0.03).apply_translation((0, 0, height + 0.03))


def wedge(angle, height):
    """A slab whose lower face meets the axis at `height`; its normal there is turned by `angle` from down to -x."""
    slab = trimesh.creation.box((0.2, 0.1, 0.02)).apply_translation((0, 0, 0.01))
    slab.apply_transform(trimesh.transformations.rotation_matrix(angle, (0, 1, 0)))
    return slab.apply_translation((0, 0, height))


@pytest.mark.parametrize("stiffness", [STIFFNESS, 4 * STIFFNESS])
def test_a_jaw_presses_a_ball_with_its_servos_force(jaw, stiffness):
    height, target = 0.05, 0.051
    simulation = pressed(jaw, ball(height), target, stiffness)
    found, place = contacts(simulation), simulation.data.qpos[0]
    assert len(found.force) == 1
    assert found.force[0] == pytest.approx(stiffness / ARM**2 * (target - place), rel=1e-3)
    assert 0 < place - (height - TIP) < 5e-4  # m that it sinks in
    np.testing.assert_allclose(found.normal[0], [0, 0, -1], atol=1e-3)
    np.testing.assert_allclose(found.position[0], [0, 0, height], atol=5e-4)
    assert (found.link[0], found.other[0]) == (jaw.link_names.index("jaw"), OBJECT)


def test_the_servos_limit_is_the_largest_force(jaw):
    found = contacts(pressed(jaw, ball(0.05), 0.19))
    assert found.force.sum() == pytest.approx(MAX_TORQUE / ARM, rel=1e-3)


@pytest.mark.parametrize("degrees", [20, 40, 60])
def test_at_a_wedge_the_normal_force_is_the_servos_over_the_cosine(jaw, degrees):
    """The slide holds the jaw against the force across it."""
    angle, height = np.radians(degrees), 0.08
    simulation = pressed(jaw, wedge(angle, height), 0.1)
    found = contacts(simulation)
    servo = STIFFNESS / ARM**2 * (0.1 - simulation.data.qpos[0])
    assert found.force.sum() == pytest.approx(servo / np.cos(angle), rel=1e-3)
    np.testing.assert_allclose(found.normal, [[-np.sin(angle), 0, -np.cos(angle)]] * len(found.force), atol=1e-3)
    # Geometry: the tip's centre is its radius away from the slab's face.
    deep = (simulation.data.qpos[0] - (height - TIP / np.cos(angle))) * np.cos(angle)
    assert 0 < deep < 5e-4


def test_the_wrench_is_in_the_sensors_frame_and_about_its_origin(jaw):
    """A ball beside the axis pushes the tip down and aside; the force passes through the tip's centre."""
    simulation = pressed(jaw, ball(0.05).apply_translation((0.012, 0, 0)), 0.08)
    found, links = contacts(simulation), jaw.forward(np.eye(4), simulation.data.qpos)
    position, rotation = jaw.sensor_frames(links)
    (wrench,) = sensor_wrenches(found, jaw.sensor_link, position, rotation)
    servo = STIFFNESS / ARM**2 * (0.08 - simulation.data.qpos[0])
    assert wrench[0] == pytest.approx(-servo, rel=1e-3)  # x is out of the gel, which is pushed in
    # A force through the centre has, about the origin, the torque of the arm between the two.
    arm = rotation[0].T @ (links[jaw.sensor_link[0], :3, 3] - position[0])
    np.testing.assert_allclose(wrench[3:], np.cross(arm, wrench[:3]), atol=2e-5 * servo / TIP)
    assert np.linalg.norm(wrench[1:3]) > 0.2 * servo
    # As forces at the contacts, in the frame of the object.
    np.testing.assert_allclose(rotation[0] @ wrench[:3], (found.force[:, None] * found.normal).sum(axis=0), atol=1e-12)


def test_a_jaw_that_meets_nothing_has_no_contacts(jaw):
    simulation = pressed(jaw, ball(0.5), 0.05)
    found = contacts(simulation)
    assert all(len(values) == 0 for values in found)
    frames = jaw.sensor_frames(jaw.forward(np.eye(4), simulation.data.qpos))
    np.testing.assert_array_equal(sensor_wrenches(found, jaw.sensor_link, *frames), np.zeros((1, 6)))


HAND = allegro()


@pytest.fixture(scope="module", params=[0, 1, 2])
def grasp(request):
    """The simulation of an Allegro at rest with its fingers around a lying cylinder, and the targets of its servos."""
    rng = np.random.default_rng(request.param)
    bar = trimesh.creation.cylinder(radius=0.03, height=0.3, sections=24)
    bar.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (1, 0, 0)))
    simulation = GraspSimulation(HAND, surface_patches(bar.subdivide().subdivide()), 0.004, HELD)
    palm = np.eye(4)
    palm[:3, 3] = [-0.055, 0, -0.06]
    targets = HAND.open_joint_positions + rng.uniform(0.2, 0.7, len(HAND.joint_link))
    targets[[0, 4, 8]] = rng.uniform(-0.1, 0.1, 3)
    targets = np.clip(targets, *(HAND.joint_range + [0.05, -0.05]).T)
    simulation.place(palm, HAND.open_joint_positions)
    assert not simulation.in_contact() and simulation.close(targets).settled
    return simulation, palm, targets


def torques_of(found, palm, joints):
    """J^T f (J,) of contact forces: their work at small changes of the joints, by the hand's kinematics alone."""
    step, torques, links = 1e-6, np.zeros(len(joints)), HAND.forward(palm, joints)
    moved = (
        HAND.forward(palm, joints + step * np.eye(len(joints))),
        HAND.forward(palm, joints - step * np.eye(len(joints))),
    )
    for position, normal, force, *pair, _ in zip(*found, strict=True):
        for link, sign in zip(pair, (1, -1), strict=True):
            if link != OBJECT:
                own = np.linalg.inv(links[link]) @ [*position, 1]
                away = (moved[0][:, link] - moved[1][:, link]) @ own / (2 * step)
                torques += sign * force * away[:, :3] @ normal
    return torques


def test_servos_balance_the_contacts_at_rest(grasp):
    simulation, palm, targets = grasp
    data, found = simulation.data, contacts(simulation)
    speed = 2 * np.sqrt(STIFFNESS * ARMATURE) + DAMPING
    servo = np.clip(STIFFNESS * (targets - data.qpos), -MAX_TORQUE, MAX_TORQUE) - speed * data.qvel
    pushed = torques_of(found, palm, data.qpos)
    assert (found.other == OBJECT).sum() >= 3 and np.abs(pushed).max() > 0.05
    inside = (np.abs(data.qpos[:, None] - HAND.joint_range) > 0.002).all(axis=1)
    assert inside.sum() >= 12
    np.testing.assert_allclose((servo + pushed)[inside], 0, atol=1e-3 * np.abs(servo).max())


def test_what_the_object_gets_is_the_reaction(grasp):
    """The engine sums the forces on each body by another way; those between links cancel in all of the hand."""
    simulation, *_ = grasp
    found, data = contacts(simulation), mujoco.MjData(simulation.model)
    mujoco.mj_copyState(simulation.model, simulation.data, data, mujoco.mjtState.mjSTATE_INTEGRATION)
    mujoco.mj_forward(simulation.model, data)
    mujoco.mj_rnePostConstraint(simulation.model, data)
    on_object, on_links = data.cfrc_ext[simulation.model.body("object").id, 3:], data.cfrc_ext[:, 3:].sum(axis=0)
    pushes = found.force[:, None] * found.normal
    np.testing.assert_allclose(pushes[found.other == OBJECT].sum(axis=0), -on_object, atol=1e-9)
    np.testing.assert_allclose(on_links, 0, atol=1e-9)


def test_asking_for_contacts_does_not_change_the_closing(grasp):
    simulation, palm, targets = grasp
    ends = []
    for ask in (False, True):
        simulation.place(palm, HAND.open_joint_positions)
        for number, _ in enumerate(simulation.closing(targets)):
            if ask and number % 50 == 0:
                contacts(simulation)
        ends.append(simulation.data.qpos.copy())
    np.testing.assert_array_equal(*ends)


def test_forces_are_sorted_and_never_pull(grasp):
    force = contacts(grasp[0]).force
    assert (np.diff(force) <= 0).all() and (force >= 0).all() and np.isfinite(force).all()


def test_frames_have_the_largest_forces_in_slots_and_the_number_of_all(jaw):
    many = SLOTS + 3
    normal = np.tile([0, 0, -1.0], (many, 1))
    force, links = np.arange(many, 0, -1.0), (np.ones(many, int), np.full(many, OBJECT))
    found = Contacts(np.ones((many, 3)), normal, force, *links, np.zeros((many, 3)))
    none = Contacts(*(values[:0] for values in found))
    position, rotation = jaw.sensor_frames(jaw.forward(np.eye(4), np.zeros((2, 1))))
    arrays = contact_arrays([none, found], jaw.sensor_link, position, rotation)
    assert arrays["contact_count"].tolist() == [0, many]
    assert not any(values[0].any() for values in arrays.values())
    np.testing.assert_array_equal(arrays["contact_force"][1], found.force[:SLOTS])
    np.testing.assert_array_equal(arrays["contact_normal"][1], normal[:SLOTS])
    assert arrays["sensor_wrench"].shape == (2, 1, 6)
    assert arrays["sensor_wrench"][1, 0, 0] == pytest.approx(-found.force.sum())  # of all contacts
