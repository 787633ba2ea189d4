import numpy as np
import pytest
import torch
from PIL import Image

from palpate.learning import checkpoints
from palpate.models import TouchDepth
from palpate.results import model_figures as figure


@pytest.fixture(scope="module")
def touch_depth(tmp_path_factory):
    """An untrained U-Net whose predictions are about where surfaces are felt."""
    torch.manual_seed(0)
    folder = tmp_path_factory.mktemp("unet") / "models/touch_depth"
    checkpoints.save(folder / "best.ckpt", "touch_depth", TouchDepth(4).eval(), {"width": 4})
    return folder


def test_touches_are_the_widest_of_each_grasp(dataset):
    for record in dataset:
        for grasp, sensor in figure.touches(record):
            assert grasp.success[sensor]
            assert len(grasp.points[sensor]) == max(len(cloud) for cloud in grasp.points)
        numbers = [grasp.number for grasp, _ in figure.touches(record)]
        assert numbers == [g.number for g in record.grasps if g.success.any()][: figure.TOUCHES]


def test_one_test_object_of_every_class_is_drawn(dataset):
    """The run has a train and a validation bottle, and a test knife."""
    assert [record.name for record in figure.first_test_objects(dataset)] == ["knife-0000"]


def test_clouds_are_in_the_frame_of_their_reading(dataset, touch_depth, tmp_path, monkeypatch):
    """Right is the sensor's y; up falls with its z, towards the reading's bottom, and with the depth, the colour."""
    drawn = []
    monkeypatch.setattr(figure, "save", lambda figure, path: drawn.append(figure))
    figure.local_predictions(dataset, touch_depth, tmp_path / "a.png")
    chosen = figure.touches(dataset["knife-0000"])
    assert len(drawn[0].axes) == 4 * len(chosen)
    for number, (grasp, sensor) in enumerate(chosen):
        reading, true, predicted, chart = drawn[0].axes[4 * number : 4 * number + 4]
        np.testing.assert_array_equal(reading.images[0].get_array(), grasp.reading[sensor])
        offsets = grasp.points[sensor][:: figure.STRIDE] - grasp.position[sensor]
        depth, right, down = (offsets @ grasp.rotation[sensor][:, axis] for axis in range(3))
        (points,) = true.collections
        places = np.asarray(points.get_offsets())
        np.testing.assert_allclose(places[:, 0], right, atol=1e-6)
        np.testing.assert_allclose(places[:, 1], -0.8 * down - 0.6 * depth, atol=1e-6)
        np.testing.assert_allclose(points.get_array(), depth, atol=1e-6)
        low, high = np.array([true.get_xlim(), true.get_ylim()]).T
        assert ((places > low) & (places < high)).all()
        assert len(predicted.collections[0].get_offsets()) > 0 and len(chart.collections[0].get_array()) == 128
        assert true.get_xlim() == predicted.get_xlim() == chart.get_xlim()


def test_the_file_is_the_same_each_time(dataset, touch_depth, tmp_path):
    for name in ("a.png", "b.png"):
        figure.local_predictions(dataset, touch_depth, tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_without_a_test_object_the_figure_says_so(dataset, touch_depth, tmp_path):
    figure.local_predictions(dataset.split("train"), touch_depth, tmp_path / "none.png")
    assert Image.open(tmp_path / "none.png").height < 100
