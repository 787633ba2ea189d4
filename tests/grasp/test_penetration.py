"""The penetration check on overlaps whose depth is known, and against brute force."""

import importlib.util
import tempfile
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.grasp.penetration import PenetrationCheck, deepest, geom_surface
from palpate.hand import allegro, from_mjcf
from palpate.hand.hand import signed_distance

HALF = np.array([0.02, 0.03, 0.04])


def in_box(points):
    return signed_distance("box", HALF, points, np.zeros((0, 4)))


def depth_in(distance, triangles):
    """Depth of triangles in one solid."""
    return deepest(triangles, np.zeros(len(triangles), int), lambda points, _: distance(points))


@settings(deadline=None, max_examples=30)
@given(depth=st.floats(0.0002, 0.015))
def test_a_plane_in_a_box_is_as_deep_as_it_is(depth):
    plate = trimesh.creation.box((0.3, 0.3, 0.01))
    plate.apply_translation((0, 0, HALF[2] + 0.005 - depth))
    assert depth_in(in_box, plate.triangles) == pytest.approx(depth, abs=1e-9)


@settings(deadline=None, max_examples=30)
@given(depth=st.floats(0.0001, 0.01), turn=st.floats(0, 6.28), aside=st.floats(-0.01, 0.01))
def test_a_spike_in_a_box_is_as_deep_as_its_tip(depth, turn, aside):
    spike = trimesh.creation.cone(radius=0.01, height=0.1, sections=5)
    spike.apply_transform(trimesh.transformations.rotation_matrix(turn, (0, 0, 1)))
    spike.apply_transform(trimesh.transformations.rotation_matrix(np.pi, (1, 0, 0)))
    spike.apply_translation((aside, aside, 0.1 + HALF[2] - depth))
    assert depth_in(in_box, spike.triangles) == pytest.approx(depth, abs=1e-9)


def test_depth_is_never_below_and_hardly_above_that_of_many_samples():
    rng = np.random.default_rng(0)
    for _ in range(10):
        ball = trimesh.creation.icosphere(subdivisions=3, radius=rng.uniform(0.02, 0.1))
        direction = rng.normal(size=3)
        ball.apply_translation(direction / np.linalg.norm(direction) * (ball.extents[0] / 2 + 0.02))
        points, _ = trimesh.sample.sample_surface(ball, 100_000, seed=1)
        sampled = max(0.0, -in_box(points).min())
        found = depth_in(in_box, ball.triangles)
        assert sampled - 0.0005 <= found <= sampled + 0.0005


def test_a_surface_that_does_not_touch_has_no_depth():
    ball = trimesh.creation.icosphere(radius=0.02)
    ball.apply_translation((0.0401, 0, 0))
    assert depth_in(in_box, ball.triangles) == 0.0


def two_fingered_hand():
    """The hand of `tests/hand/grippers.py`."""
    spec = importlib.util.spec_from_file_location("grippers", Path(__file__).parents[1] / "hand/grippers.py")
    grippers = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(grippers)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.xml"
        path.write_text(grippers.two_fingers("radian"))
        return from_mjcf(path, grippers.SENSORS)


@pytest.fixture(scope="module")
def hand():
    return allegro()


def test_a_wall_in_the_gel_is_as_deep_as_it_was_put(hand):
    links = hand.forward(np.eye(4), hand.open_joint_positions)
    wall = trimesh.creation.box((0.05, 0.5, 0.5))
    gels = hand.sensor_frames(links)[0][:3, 0] + 0.019273
    wall.apply_translation((gels.max() + 0.025 - 0.0007, 0, 0.4))
    assert PenetrationCheck(hand, wall).in_object(links) == pytest.approx(0.0007, abs=1e-5)


def test_an_open_surface_counts_as_well(hand):
    links = hand.forward(np.eye(4), hand.open_joint_positions)
    # One triangle, 1 mm below the face of the palm.
    sheet = trimesh.Trimesh([[0.0103, 0.01, -0.08], [0.0103, 0.04, -0.08], [0.0103, 0.02, -0.06]], [[0, 1, 2]])
    assert PenetrationCheck(hand, sheet).in_object(links) == pytest.approx(0.001, abs=1e-9)


def test_fingers_in_each_other_are_seen_and_the_open_hand_is_free(hand):
    check = PenetrationCheck(hand, trimesh.creation.box((0.01, 0.01, 0.01)))
    assert check.in_itself(hand.forward(np.eye(4), hand.open_joint_positions)) == 0.0
    # Bent fingers, index and middle turned towards each other.
    crossed = hand.open_joint_positions.copy()
    crossed[[1, 5]] = 1.2
    crossed[[0, 4]] = 0.47, -0.47
    tips = hand.sensor_frames(hand.forward(np.eye(4), crossed))[0]
    assert tips[0, 1] > tips[1, 1]  # index, at -y when open, is now beyond the middle finger
    crossed[[0, 4]] = 0.25, -0.25
    assert check.in_itself(hand.forward(np.eye(4), crossed)) > 0.005


def test_self_check_misses_no_pair(hand):
    """Separating axes only skip pairs that don't overlap: the same depth without them."""
    rng = np.random.default_rng(3)
    check = PenetrationCheck(hand, trimesh.creation.box((0.01, 0.01, 0.01)))
    for _ in range(5):
        links = hand.forward(np.eye(4), rng.uniform(*hand.joint_range.T))
        poses = hand.geom_poses(links)
        brute = 0.0
        for one, other in hand.colliding_pairs:
            for inner, outer in ((one, other), (other, one)):
                surface = geom_surface(hand, inner) @ poses[inner, :3, :3].T + poses[inner, :3, 3]
                found = depth_in(lambda p, g=outer, at=poses[outer]: hand.geom_distance(g, p, at), surface)
                brute = max(brute, found)
        assert check.in_itself(links) == pytest.approx(brute, abs=1e-12)


def test_no_triangle_near_a_geom_is_left_out():
    """The depth of all triangles in each geom, of a hand with every kind of geom but a sphere."""
    hand, rng = two_fingered_hand(), np.random.default_rng(4)
    check, deep = PenetrationCheck(hand, trimesh.creation.icosphere(subdivisions=2, radius=0.05)), 0
    for _ in range(12):
        links = hand.forward(np.eye(4), rng.uniform(*hand.joint_range.T))
        links[:, :3, 3] += rng.uniform(-0.1, 0.1, 3)
        poses = hand.geom_poses(links)
        each = [
            depth_in(lambda p, g=geom: hand.geom_distance(g, p, poses[g]), check.triangles)  # noqa: B023
            for geom in np.flatnonzero(hand.geom_collides)
        ]
        assert check.in_object(links) == pytest.approx(max(each), abs=1e-12)
        deep += max(each) > 0
    assert deep > 3
