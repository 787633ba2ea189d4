"""Grasps across an object: pairs in closed form, the friction at which balls, boxes and cones slip, the grip, and what
grasps, frames and labels say of each other."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
import trimesh

from palpate.batch import UnusableObject, generator
from palpate.grasp import Grasper, closing_frames, grasp_object, grasper_type, hold_grasps
from palpate.grasp.antipodal import CLEARANCE, AntipodalGrasper, opposing_points, sides_of
from palpate.grasp.contacts import contacts, on_object
from palpate.grasp.hold import GAIN, GRAVITY, GripSimulation, body_of
from palpate.grasp.patches import surface_patches
from palpate.grasp.targets import Surface
from palpate.hand import Hand, allegro, from_mjcf
from palpate.hand.model import ARM
from palpate.mesh import OBJECT_POSITION
from palpate.surface.embree import RayMesh

HANDS = Path(__file__).parents[2] / "config/hands"
GRIPPER = from_mjcf(HANDS / "wsg50.xml", HANDS / "wsg50.yaml")
GRIP, TIMESTEP, DISTANCE = 5.0, 0.004, 0.02
TEST = {"friction": 0.8, "density": 100.0, "distance": DISTANCE, "duration": 0.5}
BOX = trimesh.creation.box((0.06, 0.03, 0.1))
GEL = np.array([0.0406, 0, 0])  # m, the middle between the jaws' gels in the palm's frame


def points_of(mesh, count=2000):
    points, face = trimesh.sample.sample_surface(mesh, count, seed=0)
    return Surface(points, mesh.face_normals[face])


def drawn(mesh, friction, widest, count=20):
    rng = np.random.default_rng(0)
    rays, surface = RayMesh(mesh), points_of(mesh)
    return np.concatenate([opposing_points(surface, rays, friction, widest, rng) for _ in range(count)])


def test_pairs_of_a_ball_are_chords_within_the_friction_cone():
    """A chord makes the same angle with both normals; its length is the diameter times the angle's cosine."""
    ball, radius, friction = trimesh.creation.icosphere(5, 0.03), 0.03, 0.5
    pairs = drawn(ball, friction, 0.1)
    width = np.linalg.norm(pairs[:, 1] - pairs[:, 0], axis=1)
    least = 1 / np.hypot(1, friction)
    assert len(pairs) > 500
    assert width.min() > 2 * radius * least - 1e-3 and width.max() < 2 * radius + 1e-6
    assert width.min() < 2 * radius * least + 1e-3
    np.testing.assert_allclose(np.linalg.norm(pairs, axis=-1), radius, atol=1e-4)
    assert not len(drawn(ball, friction, 2 * radius * least - 2e-3))  # a narrower hand


def test_pairs_of_a_box_are_on_opposite_faces():
    pairs = drawn(BOX, 0.3, 0.2)
    across = np.abs(pairs[:, 1] - pairs[:, 0])
    on = np.abs(np.abs(pairs) - BOX.extents / 2) < 1e-6
    same = (on[:, 0] & on[:, 1] & (np.sign(pairs[:, 0]) == -np.sign(pairs[:, 1]))).any(axis=1)
    assert len(pairs) > 300 and same.all()
    length = np.linalg.norm(across, axis=1)
    assert (across.max(axis=1) / length > 1 / np.hypot(1, 0.3) - 1e-9).all()


def test_there_is_room_for_a_finger_at_both_points():
    """Two plates 30 mm apart: pairs are of one plate, or of both. With half of a finger's room only of both."""
    for gap, widths in ((0.03, {0.01, 0.05}), (CLEARANCE / 2, {0.02 + CLEARANCE / 2})):
        plates = [
            trimesh.creation.box((0.1, 0.1, 0.01)).apply_translation((0, 0, s * (gap + 0.01) / 2)) for s in (-1, 1)
        ]
        pairs = drawn(trimesh.util.concatenate(plates), 1e-3, 0.09)
        flat = pairs[np.abs(pairs[:, 1, 2] - pairs[:, 0, 2]) > 0.005]
        assert len(flat) > 100
        assert set(np.round(np.abs(flat[:, 1, 2] - flat[:, 0, 2]), 4)) == {round(each, 4) for each in widths}


def gripped(mesh, half, friction, weight=0.0):
    """How far a mesh between the jaws, `half` m wide on each side, moves: while they close, or under a weight (N) along
    y afterwards; infinity if it slips out of them."""
    mesh = mesh.copy().apply_translation(GEL)
    density = max(weight, 0.5) / GRAVITY / mesh.volume
    simulation = GripSimulation(GRIPPER, surface_patches(mesh), body_of(mesh, density), friction, TIMESTEP, grip=GRIP)
    simulation.sides = np.array([1, -1])
    simulation.place(np.eye(4), np.full(2, half + 0.005))
    closed = simulation.close(np.full(2, half - 0.01))
    if not on_object(contacts(simulation)).force.sum() > GRIP:
        return np.inf
    targets, pose = simulation.data.ctrl.copy(), np.linalg.inv(simulation.object_pose)
    gravity = np.array([0, GRAVITY * (weight > 0), 0])
    moved = simulation.moved(pose, closed.joint_positions, targets, gravity, 1.0, DISTANCE)
    return max(moved, np.linalg.norm(pose[:3, 3]))


SLIPPED = 0.005  # m; farther on, a gel's edge catches on a seam between two patches of a flat face


@pytest.mark.parametrize("name", ["ball", "box"])
@pytest.mark.parametrize("friction", [0.3, 0.8])
def test_a_ball_and_a_box_slip_where_friction_carries_less_than_the_weight(name, friction):
    """Two jaws of one grip carry twice friction times grip."""
    half = 0.02
    mesh = trimesh.creation.icosphere(3, half) if name == "ball" else trimesh.creation.box((0.03, 0.06, 2 * half))
    carried = 2 * friction * GRIP
    assert gripped(mesh, half, friction, 0.9 * carried) < SLIPPED
    assert gripped(mesh, half, friction, 1.1 * carried) > SLIPPED


@pytest.mark.parametrize("degrees", [15, 25])
def test_a_cone_is_squeezed_out_where_friction_is_less_than_the_tangent_of_its_angle(degrees):
    """Jaws across a cone, whose sides are `degrees` off its axis: friction alone keeps it, without any weight."""
    slope, height = np.tan(np.radians(degrees)), 0.06
    cone = trimesh.creation.cone(slope * height, height, sections=64)
    cone.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (1, 0, 0)))  # its axis along y
    cone.apply_translation((0, height / 2, 0))
    half = slope * (height / 2)
    assert gripped(cone, half, 1.1 * slope) < 0.0005
    assert gripped(cone, half, 0.9 * slope) > 0.002  # or on until its tip


@pytest.fixture(scope="module")
def grasped():
    return grasp_across()


def kinds(**changes):
    keys = {"placement": "antipodal", "object": "loose", "grip": GRIP, "keep": "hold"} | changes
    return grasper_type(keys, TEST)


def grasp_across(seed=0, hand=GRIPPER, mesh=BOX, kept=2, **changes):
    points = points_of(mesh).points + OBJECT_POSITION
    rng = generator(seed, "box")
    return grasp_object(mesh, mesh, points, hand, rng, kept, kept, 30, grasper_type=kinds(**changes))


def again(**changes):
    return kinds(**changes)(BOX, BOX, points_of(BOX).points, GRIPPER)


def test_kept_grasps_hold_and_the_record_says_how_many_were_tried(grasped):
    kept = vars(grasped) | grasped.more
    found = hold_grasps(again(), kept, None)
    assert (found["held"] == 1).all() and (found["moved"] <= DISTANCE).all()
    assert (found["wrench_radius"] >= 0).all() and ((found["cone_margin"] > 0) & (found["cone_margin"] <= 1)).all()
    assert len(grasped.touches) <= grasped.made <= grasped.attempts
    assert grasped.touches.all()  # both jaws


def test_the_grip_is_reached_on_both_sides(grasped):
    """By the servos, which press along the jaws; the normal force at a tilted face is less by what friction carries."""
    beyond = grasped.joint_positions - grasped.more["servo_positions"]
    np.testing.assert_allclose(beyond * GAIN / ARM**2, GRIP, rtol=0.03)
    force = grasped.more["sensor_force"]
    assert ((force > 0.6 * GRIP) & (force < 1.1 * GRIP)).all()


@pytest.mark.parametrize("gain", [0.1, 1, 10])
def test_the_grip_is_that_of_the_key_whatever_the_gain(gain):
    half = 0.02
    box = trimesh.creation.box((0.03, 0.03, 2 * half)).apply_translation(GEL)
    body = body_of(box, 100.0)
    simulation = GripSimulation(GRIPPER, surface_patches(box), body, 0.8, TIMESTEP, grip=GRIP, stiffness=gain * GAIN)
    simulation.sides = np.array([1, -1])
    simulation.place(np.eye(4), np.full(2, half + 0.01))
    assert simulation.close(np.full(2, half - 0.01)).settled
    pressed = on_object(contacts(simulation))
    assert pressed.force.sum() == pytest.approx(2 * GRIP, rel=0.03)


def test_the_last_frame_is_the_grasp_bit_for_bit(grasped):
    kept = vars(grasped) | grasped.more
    frames = closing_frames(again(), kept, None, 5, with_contacts=True)
    for name in ("joint_positions", "link_pose", "sensor_position", "sensor_rotation"):
        np.testing.assert_array_equal(frames[name][:, -1], kept[name])
    position, count = frames["contact_position"][:, -1], frames["contact_count"][:, -1]
    on_box = np.abs(np.abs(position[0, : count[0]] - OBJECT_POSITION) - BOX.extents / 2).min(axis=1)
    assert on_box.max() < 1e-3


def test_the_same_generator_gives_the_same(grasped):
    other = grasp_across()
    for name, values in grasped.more.items():
        np.testing.assert_array_equal(other.more[name], values)


def test_a_held_object_stays_where_it_is():
    held = grasp_across(object="held", keep="touches")
    np.testing.assert_array_equal(held.more["start_pose"][:, :3, :3], held.palm_pose[:, :3, :3])


def test_surface_placement_draws_and_closes_as_before():
    """The loop of grasps on the surface, written out."""
    hand, rng = allegro(), generator(0, "surface")
    points = points_of(BOX).points + OBJECT_POSITION
    found = grasp_object(BOX, BOX, points, hand, generator(0, "surface"), 2, 2)
    grasper, expected = Grasper(BOX, BOX, points - OBJECT_POSITION, hand), []
    while len(expected) < 2:
        pose = grasper.free_palm_pose(rng)
        thumb = rng.random() < grasper.thumb_share
        result = grasper.closed_at(pose, grasper.workspace.targets(pose, grasper.surface, thumb))
        expected += [result] * (not isinstance(result, str))
    expected.sort(key=lambda grasp: -grasp.touches.sum())
    np.testing.assert_array_equal(found.joint_positions, [each.joint_positions for each in expected])
    plain = grasper_type({"placement": "surface", "keep": "touches"}, {})
    assert not found.more and plain.func is Grasper and not plain.keywords["only_held"]


def test_keep_hold_is_also_for_grasps_on_the_surface():
    kind = grasper_type({"placement": "surface", "keep": "hold"}, TEST)
    with pytest.raises(UnusableObject, match="does not hold"):
        grasp_object(
            BOX, BOX, points_of(BOX).points + OBJECT_POSITION, GRIPPER, generator(0, "box"), 1, 1, 5, grasper_type=kind
        )


def test_sides_are_the_thumbs_the_open_hands_or_those_of_the_file():
    assert sides_of(allegro()).tolist() == [-1, -1, -1, 1]
    assert sides_of(GRIPPER).tolist() == [1, -1]
    named = from_mjcf(HANDS / "wsg50.xml", {"palm": "palm", "anchor": "face", "open": [0.055, 0.055],
        "sensors": [{"site": "upper_gel"}, {"site": "lower_gel"}], "opposes": ["lower_gel"]})  # fmt: skip
    assert sides_of(named).tolist() == [-1, 1]
    assert sides_of(Hand.from_arrays(named.to_arrays())).tolist() == [-1, 1]
    assert "opposing_sensors" not in GRIPPER.to_arrays()


def test_the_allegro_holds_a_bar_between_thumb_and_fingers():
    bar = trimesh.creation.box((0.03, 0.03, 0.12)).subdivide()
    kind = partial(AntipodalGrasper, hold=TEST, only_held=True, grip=GRIP)
    found = grasp_object(
        bar, bar, points_of(bar).points + OBJECT_POSITION, allegro(), generator(0, "bar"), 1, 1, 40, grasper_type=kind
    )
    assert (found.more["sensor_side"][0] == 1).tolist() == [False, False, False, True]
    assert found.more["sensor_force"][0, 3] > 0.5 * GRIP


def test_an_object_wider_than_the_hand_is_refused_with_the_reason():
    with pytest.raises(UnusableObject, match="no palm pose free of the object"):
        wide = trimesh.creation.icosphere(2, 0.2)
        grasp_across(mesh=wide, keep="touches")
