"""Figures of one grasp that Blender renders: its steps, its closing, and the view that they are seen from."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from PIL import Image

from palpate.hand import allegro
from palpate.mesh import OBJECT_POSITION, load_visual
from palpate.results import grasp_figures as figures
from palpate.results.dataset_figures import example_grasp
from palpate.results.grasp_figures import camera_holding, clear_view, grasp_steps
from palpate.scene import Scene
from palpate.vision import Renderer

QUICK = {"samples": 1}


def test_the_hand_comes_is_placed_and_closes(dataset, monkeypatch, tmp_path):
    drawn = []
    monkeypatch.setattr(figures, "save", lambda figure, path: drawn.append(figure))
    monkeypatch.setattr(figures, "STEP_PIXELS", 60)
    grasp_steps(dataset, tmp_path / "a.png", **QUICK)
    pictures = [np.asarray(axes.images[0].get_array()).astype(int) for axes in drawn[0].axes]
    alone, *with_hand = [(picture.max(axis=-1) < 60).sum() for picture in pictures]  # the hand is black
    assert len(with_hand) == 3 and min(with_hand) > alone + 20
    _, loaded, placed, closed = pictures
    assert all((one != other).any() for one, other in ((loaded, placed), (placed, closed)))


def test_the_closing_shows_frames_evenly_and_rests_at_the_last(dataset, monkeypatch, tmp_path):
    monkeypatch.setattr(figures, "PIXELS", 60)
    monkeypatch.setattr(figures, "FRAMES", 2)
    grasp = example_grasp(dataset)
    opened = grasp.object.hand.forward(grasp.palm_pose, grasp.object.hand.open_joint_positions)
    success = np.array([np.zeros_like(grasp.success)] * 2 + [grasp.success])
    frames = SimpleNamespace(link_pose=np.array([opened] * 2 + [grasp.link_pose]), time=[0.0, 0.7, 1.5])
    frames.reading, frames.success, frames.has_touch = np.array([grasp.reading] * 3), success, True
    framed = SimpleNamespace(object=grasp.object, sensors=grasp.sensors, frames=frames)
    monkeypatch.setattr(figures, "example_grasp", lambda dataset: framed)
    figures.closing(dataset, tmp_path / "a.gif", **QUICK)
    with Image.open(tmp_path / "a.gif") as animation:
        assert animation.n_frames == 2 and animation.info["duration"] == figures.PAUSE
        first = np.asarray(animation.convert("RGB"))
        animation.seek(1)
        assert animation.info["duration"] == figures.REST
        assert (np.asarray(animation.convert("RGB")) != first).any()


def test_poses_are_rendered_in_one_session_and_each_as_if_it_were_alone(dataset, monkeypatch):
    """The object's file is read once; of each pose the same bytes come from a new Blender scene of its own."""
    scenes, files, read = [], [], Renderer._read_file
    monkeypatch.setattr(Renderer, "_read_file", lambda self, path: (files.append(path), read(self, path)))
    monkeypatch.setattr(figures, "Scene", lambda *given, **others: scenes.append(Scene(*given, **others)) or scenes[-1])
    grasp = example_grasp(dataset)
    opened = grasp.object.hand.forward(grasp.palm_pose, grasp.object.hand.open_joint_positions)
    poses = np.array([opened, grasp.link_pose, opened])
    alone, *held = figures.rendered(grasp, poses, 60, Renderer(samples=2))
    assert len(files) == 1 and len(held) == 3
    for pose, picture in zip(poses, held, strict=True):
        bare, (image,) = Renderer(samples=2).render(replace(scenes[0], link_pose=pose[None]))
        np.testing.assert_array_equal(image.rgb, picture)
        np.testing.assert_array_equal(bare.rgb, alone)


def test_drawn_points_are_on_the_hand(dataset):
    hand, grasp = allegro(), example_grasp(dataset)
    points = figures.hand_points(hand, grasp.link_pose)
    assert hand.signed_distance(points, grasp.link_pose).max() < 1e-9


def towards(azimuth, elevation):
    turn, tilt = np.radians([azimuth, elevation])
    return np.array([np.cos(turn) * np.cos(tilt), np.sin(turn) * np.cos(tilt), np.sin(tilt)])


def test_the_camera_holds_everything_and_no_more():
    rng = np.random.default_rng(0)
    for _ in range(20):
        points = OBJECT_POSITION + rng.normal(size=(50, 3)) * rng.uniform(0.05, 0.2, size=3)
        camera = camera_holding(points, towards(rng.uniform(0, 360), rng.uniform(-60, 60)), 240)
        seen, depth = camera.project(points)
        assert (depth > 0).all() and seen.min() > 0 and seen.max() < camera.size
        assert np.abs(seen / camera.size - 0.5).max() == pytest.approx(0.5 / figures.MARGIN)


@pytest.mark.parametrize("azimuth", [0, 90, 210])
def test_points_on_a_ball_are_looked_at_from_their_side(monkeypatch, azimuth):
    monkeypatch.setattr(figures, "load_visual", lambda mesh: trimesh.creation.icosphere(4, 0.2))
    rng = np.random.default_rng(0)
    cap = towards(azimuth, 0) + 0.2 * rng.normal(size=(200, 3))
    cap = OBJECT_POSITION + 0.2 * cap / np.linalg.norm(cap, axis=1, keepdims=True)
    view = clear_view(SimpleNamespace(mesh=None), cap)
    np.testing.assert_allclose(view, towards(azimuth, figures.ELEVATION), atol=1e-12)
    assert np.linalg.norm(clear_view(SimpleNamespace(mesh=None), np.zeros((0, 3)))) == pytest.approx(1)


def test_the_object_hides_the_hand_least_from_the_clear_view(dataset):
    """By trimesh's rays, of all directions that are looked at."""
    grasp = example_grasp(dataset)
    mesh = load_visual(grasp.object.mesh)
    points = figures.hand_points(allegro(), grasp.link_pose)[::25]

    def hidden(direction):
        start = points - OBJECT_POSITION + figures.LIFT * direction
        return mesh.ray.intersects_any(start, np.tile(direction, (len(points), 1))).mean()

    every = [hidden(towards(azimuth, figures.ELEVATION)) for azimuth in figures.AZIMUTHS]
    assert hidden(clear_view(grasp.object, points)) <= min(every) + 0.01
