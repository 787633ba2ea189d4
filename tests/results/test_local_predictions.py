import numpy as np
import pytest
import torch
from PIL import Image

from palpate.inference import checkpoints
from palpate.models import TouchDepth
from palpate.results import local_predictions as figure
from palpate.results.page import DPI
from palpate.touch import SENSOR_WIDTH


@pytest.fixture(scope="module")
def touch_depth(tmp_path_factory):
    """An untrained U-Net whose predictions are about where surfaces are felt."""
    torch.manual_seed(0)
    folder = tmp_path_factory.mktemp("unet") / "models/touch_depth"
    checkpoints.save(folder / "best.ckpt", "touch_depth", TouchDepth(4).eval(), {"width": 4})
    return folder


def rotation(seed):
    turn, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return turn * np.linalg.det(turn)


@pytest.mark.parametrize("seed", range(3))
def test_a_site_is_seen_from_the_sensor_as_its_reading_shows_it(seed):
    """The reading's columns go right, its rows to the front; near to the sensor is near to the camera."""
    turn, camera = rotation(seed), figure.site_camera(200)

    def seen(x, y, z):
        offset = np.array([[x, y, z]]) @ turn.T  # of the sensor's frame, to the world
        pixels, depth = camera.project(figure.upright(offset, turn, SENSOR_WIDTH))
        return pixels[0], depth[0]

    step = SENSOR_WIDTH / 2
    (middle, depth), (right, _) = seen(0, 0, 0), seen(0, step, 0)
    (front, nearer), (towards, nearest) = seen(0, 0, step), seen(-step, 0, 0)
    np.testing.assert_allclose(middle, [100, 100], atol=1e-6)
    assert right[0] > 130 and abs(right[1] - 100) < 1
    assert front[1] > 130 and abs(front[0] - 100) < 1
    assert towards[1] < 100 and nearest < nearer < depth
    # All of the sensor is in the picture.
    corners = np.array([seen(0, y, z)[0] for y in (-step, step) for z in (-step, step)])
    assert corners.min() > 10 and corners.max() < 190


def test_touches_are_the_widest_of_each_grasp(dataset):
    for record in dataset:
        for grasp, sensor in figure.touches(record):
            assert grasp.success[sensor]
            assert len(grasp.points[sensor]) == max(len(cloud) for cloud in grasp.points)
        numbers = [grasp.number for grasp, _ in figure.touches(record)]
        assert numbers == [g.number for g in record.grasps if g.success.any()][: figure.TOUCHES]


def test_the_true_cloud_is_in_the_middle(dataset):
    grasp, sensor = figure.touches(dataset["knife-0000"])[0]
    true, _, chart = figure.site(grasp, sensor, grasp.points[sensor], np.zeros((81, 3)))
    camera = figure.site_camera(figure.PIXELS)
    pixels, depth = camera.project(np.asarray(true[0].vertices))
    assert (depth > 0).all() and pixels.min() > 0 and pixels.max() < figure.PIXELS
    assert len(chart) == 2 and len(chart[0].faces) == 128


def test_clouds_and_charts_are_in_their_columns(dataset, touch_depth, tmp_path, monkeypatch):
    monkeypatch.setattr(figure, "PIXELS", 60)
    monkeypatch.setattr(figure, "SAMPLES", 2)
    monkeypatch.setattr(figure, "STRIDE", 71)
    figure.local_predictions(dataset, touch_depth, tmp_path / "a.png")
    figure.local_predictions(dataset, touch_depth, tmp_path / "b.png")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    picture = np.asarray(Image.open(tmp_path / "a.png").convert("RGB")).astype(int)
    body = picture[round(0.55 * DPI) :]
    for place in range(len(figure.touches(dataset["knife-0000"]))):
        start = 0.3 + place * (4 * 1.39 + 0.22)
        panels = [body[:, round((start + c * 1.39) * DPI) : round((start + c * 1.39 + 1.35) * DPI)] for c in range(4)]
        red, blue = [[(p[..., i] > 1.3 * p[..., j]).any() for p in panels] for i, j in ((0, 2), (2, 0))]
        drawn = [(p.min(axis=-1) < 200).any() for p in panels]
        assert all(drawn)
        assert not red[1] and not blue[1]  # grey
        assert blue[2] and not red[2]
        assert red[3] and not blue[3]


def test_without_a_test_object_the_figure_says_so(dataset, touch_depth, tmp_path):
    figure.local_predictions(dataset.split("train"), touch_depth, tmp_path / "none.png")
    assert Image.open(tmp_path / "none.png").height < 100
