from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from palpate.hand import allegro, from_mjcf
from palpate.mesh import OBJECT_POSITION, load_visual
from palpate.results import grasp_steps as steps
from palpate.results.dataset_figures import example_grasp
from tests.hand import grippers


@pytest.fixture
def grasp(dataset):
    return example_grasp(dataset)


def test_the_stored_hand_is_the_hand_that_was_stored(grasp):
    stored, made = grasp.object.hand.to_arrays(), allegro().to_arrays()
    assert stored.keys() == made.keys()
    for name in made:
        np.testing.assert_array_equal(stored[name], made[name])


def test_drawn_points_are_on_the_hand(grasp):
    hand = allegro()
    points = steps.hand_points(hand, grasp.link_pose)
    assert hand.signed_distance(points, grasp.link_pose).max() < 1e-9


@pytest.mark.parametrize("azimuth, elevation", [(0, 15), (130, 35), (250, 15)])
def test_the_loaded_hand_stands_clear_of_the_object_and_to_its_right(grasp, azimuth, elevation):
    towards = steps.direction(azimuth, elevation)
    points = grasp.object.points.astype(float)
    hand = allegro()
    palm = steps.beside(points, towards, hand)
    np.testing.assert_allclose(palm[:3, :3] @ palm[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(palm[:3, :3]) == pytest.approx(1)
    pose = hand.forward(palm, hand.open_joint_positions)
    assert hand.signed_distance(points, pose).min() > 0.02
    drawn = steps.hand_points(hand, pose)
    camera = steps.camera_holding(np.concatenate([points, drawn]), towards)
    assert camera.project(drawn)[0][:, 0].min() > camera.project(points)[0][:, 0].max()


@pytest.mark.parametrize("turn", ["0 0 0", "0 90 0", "120 -40 60"])
def test_an_own_hand_faces_the_object_with_its_palms_face(grasp, tmp_path, turn):
    """However the palm's face lies in the palm's frame, it looks left in the picture, its fingers up."""
    model = grippers.two_fingers("degree").replace('name="face"', f'name="face" euler="{turn}"')
    (tmp_path / "hand.xml").write_text(model)
    hand = from_mjcf(tmp_path / "hand.xml", grippers.SENSORS)
    towards, points = steps.direction(130, 35), grasp.object.points
    palm = steps.beside(points, towards, hand)
    camera = steps.camera_holding(points, towards)
    face = palm @ hand.palm_anchor
    np.testing.assert_allclose(face[:3, 2], (0, 0, 1), atol=1e-12)
    at, ahead = camera.project(face[:3, 3] + 0.01 * np.array([np.zeros(3), face[:3, 0]]))[0]
    assert ahead[0] < at[0] - 1
    drawn = steps.hand_points(hand, hand.forward(palm, hand.open_joint_positions))
    assert camera.project(drawn)[0][:, 0].min() > camera.project(points)[0][:, 0].max()


def test_the_best_view_does_not_depend_on_the_palms_frame(grasp):
    """The same hand whose palm frame is turned about its face."""
    hand, turn = allegro(), np.eye(4)
    turn[:3, :3] = np.roll(np.eye(3), 1, axis=0)
    turned = replace(hand, palm_anchor=turn.T @ hand.palm_anchor)
    same = SimpleNamespace(object=grasp.object, link_pose=grasp.link_pose, palm_pose=grasp.palm_pose @ turn)
    np.testing.assert_array_equal(steps.best_direction(same, turned), steps.best_direction(grasp, hand))


def test_the_camera_holds_everything_and_no_more():
    rng = np.random.default_rng(0)
    for _ in range(20):
        points = OBJECT_POSITION + rng.normal(size=(50, 3)) * rng.uniform(0.05, 0.2, size=3)
        towards = steps.direction(rng.uniform(0, 360), rng.uniform(-60, 60))
        camera = steps.camera_holding(points, towards)
        pixels, depth = camera.project(points)
        assert (depth > 0).all() and pixels.min() > 0 and pixels.max() < camera.size
        assert np.abs(pixels / camera.size - 0.5).max() == pytest.approx(0.5 / steps.MARGIN)


def test_the_object_does_not_hide_the_hand_from_the_best_view(grasp):
    hand = allegro()
    towards = steps.best_direction(grasp, hand)
    assert np.linalg.norm(towards) == pytest.approx(1)
    mesh = load_visual(grasp.object.mesh)
    points = steps.hand_points(hand, grasp.link_pose)[::25] - OBJECT_POSITION

    def hidden(direction):
        return mesh.ray.intersects_any(points, np.tile(direction, (len(points), 1))).mean()

    every = [hidden(steps.direction(a, e)) for a in steps.AZIMUTHS[::2] for e in steps.ELEVATIONS]
    assert hidden(towards) <= np.median(every)


def test_pictures_are_cut_alike_and_lose_nothing():
    pictures = [np.zeros((40, 50, 4), np.uint8) for _ in range(2)]
    pictures[0][10:20, 0:8] = 200
    pictures[1][15:30, 20:50] = 100
    cut = steps._cropped(pictures)
    assert cut[0].shape == cut[1].shape and cut[0].shape[0] == 20
    for before, after in zip(pictures, cut, strict=True):
        assert (after > 0).sum() == (before > 0).sum()
        columns = np.flatnonzero(after[..., 3].any(axis=0))
        assert columns[0] + columns[-1] == pytest.approx(after.shape[1] - 1, abs=1)


def test_the_hand_comes_in_at_the_second_step(dataset, tmp_path, monkeypatch):
    monkeypatch.setattr(steps, "PIXELS", 120)
    steps.grasp_steps(dataset, tmp_path / "a.png", samples=2)
    steps.grasp_steps(dataset, tmp_path / "b.png", samples=2)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    picture = np.asarray(Image.open(tmp_path / "a.png").convert("L"))
    drawn = picture[: -round(0.6 * 130)] < 250
    amounts = [panel.sum() for panel in np.array_split(drawn, 4, axis=1)]
    assert amounts[1] > 1.1 * amounts[0] > 0
    assert len(set(amounts)) == 4
