import numpy as np
import pytest
import torch
from PIL import Image

from palpate.architectures import Architecture
from palpate.charts import sphere, touch_chart, vision_atlas
from palpate.experiments import Experiment
from palpate.learning import checkpoints
from palpate.learning.reconstruct import TOUCH_COLOUR, VISION_COLOUR, Shape
from palpate.models import TouchDepth
from palpate.models.templates import Templates
from palpate.results import model_figures as figure
from palpate.results import products
from tests.learning.synthetic import DECLARED
from tests.models.batches import SMALL

EXPERIMENTS = {
    each.name: each for each in (Experiment("template_touch_any", "template", "none", True, 2, fewer_grasps=True),)
}


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    """Folders of untrained models, beside a U-Net."""
    folder = tmp_path_factory.mktemp("models") / "models"
    torch.manual_seed(0)
    unet = {"width": 4}
    checkpoints.save(folder / "touch_depth/best.ckpt", "touch_depth", TouchDepth(**unet).eval(), unet)
    for name, experiment in EXPERIMENTS.items():
        described = {"experiment": experiment.row(), "architecture": SMALL}
        model = checkpoints.build(experiment, Architecture.from_row(SMALL), templates=Templates(sphere()[0][None]))
        checkpoints.save(folder / name / "seed-0/best.ckpt", "reconstruction", model, described)
    return {name: folder / name / "seed-0" for name in EXPERIMENTS}


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setattr(figure, "PIXELS", 80)
    monkeypatch.setattr(figure, "SAMPLES", 2)


def hue(pixels):
    """Where pixels (..., 3) have more of one colour than of another: +1 orange, -1 blue, 0 neither."""
    red, blue = pixels[..., 0].astype(int), pixels[..., 2].astype(int)
    return np.where(red > 1.6 * blue, 1, np.where(blue > 1.15 * red, -1, 0))


def test_the_charts_of_successful_touches_are_orange():
    atlas, chart = vision_atlas(), touch_chart()
    shape = Shape(
        np.concatenate([atlas.vertices.numpy(), np.zeros((81, 3))]),
        np.concatenate([atlas.faces.numpy(), chart.faces.numpy() + len(atlas.vertices)]),
        np.repeat([False, True], [len(atlas.faces), len(chart.faces)]),
    )
    colours = figure.coloured(shape).colours
    assert (colours[: len(atlas.faces)] == VISION_COLOUR).all() and (colours[len(atlas.faces) :] == TOUCH_COLOUR).all()


def test_ground_truth_is_the_objects_surface_in_the_world(dataset):
    record = dataset["knife-0000"]
    mesh = figure.clay(record)
    low, high = record.points.min(axis=0), record.points.max(axis=0)
    np.testing.assert_allclose(np.min(mesh.vertices, axis=0), low, atol=0.005)
    np.testing.assert_allclose(np.max(mesh.vertices, axis=0), high, atol=0.005)


def test_ground_truth_without_meshes_is_of_points(dataset):
    class Released:
        mesh = dataset["knife-0000"].mesh.parent / "nothing"
        points = dataset["knife-0000"].points

    mesh = figure.clay(Released)
    assert np.abs(np.min(mesh.vertices, axis=0) - Released.points.min(axis=0)).max() < 0.005


def test_every_number_of_grasps_has_its_column(dataset, models, tmp_path, small, monkeypatch):
    drawn = []
    monkeypatch.setattr(figure, "save", lambda figure, path: drawn.append(figure))
    monkeypatch.setitem(figure.MODELS, "template_touch_any", ("touch only", (1, 2)))
    figure.reconstructions(dataset, models, tmp_path / "a.png")
    panels = drawn[0].axes
    titles = ["occluded\nimage", "unoccluded\nimage", "ground\ntruth", "touch only\n1 grasp", "touch only\n2 grasps"]
    assert [panel.get_title() for panel in panels] == titles
    occluded, unoccluded, truth, *ours = (np.asarray(panel.images[0].get_array()) for panel in panels)
    np.testing.assert_array_equal(occluded, dataset["knife-0000"].grasps[0].occluded)
    np.testing.assert_array_equal(unoccluded, dataset["knife-0000"].unoccluded)
    assert (hue(truth) == 0).all() and all(0.05 < (hue(picture) == -1).mean() < 0.9 for picture in ours)


def test_a_row_is_cut_to_what_its_pictures_show():
    pictures = [np.full((size, size, 3), 200, np.uint8) for size in (100, 50)]
    pictures[0][20:40, 10:30] = 0  # rows 0.2 to 0.4, columns 0.1 to 0.3
    pictures[1][15:25, 30:35, 1] = 10  # rows 0.3 to 0.5, columns 0.6 to 0.7
    (left, top), (right, bottom) = figure.window(pictures)
    assert right - left == pytest.approx(bottom - top) == pytest.approx(0.6 * figure.MARGIN, abs=0.03)
    assert (left + right) / 2 == pytest.approx(0.4, abs=0.02) and (top + bottom) / 2 == pytest.approx(0.35, abs=0.02)


def test_renders_are_from_the_images_camera(dataset, models, tmp_path, small, monkeypatch):
    """The truth covers the pixels that its points project to."""
    drawn = []
    monkeypatch.setattr(figure, "save", lambda figure, path: drawn.append(figure))
    figure.reconstructions(dataset, {}, tmp_path / "a.png")
    truth = np.asarray(drawn[0].axes[2].images[0].get_array())
    record = dataset["knife-0000"]
    seen, _ = record.vision_camera.project(record.points)
    column, row = (seen * len(truth) / record.vision_camera.size).astype(int).T
    covered, hit = (truth < 250).any(axis=-1), np.zeros(truth.shape[:2], dtype=bool)
    hit[row, column] = True
    assert (covered & hit).sum() > 0.8 * (covered | hit).sum()  # a pixel at the outline is white in part


def test_every_column_has_an_experiment_and_its_model_in_the_rule():
    assert set(figure.MODELS) <= set(DECLARED.experiments)
    product, _ = products.find("figures", "reconstructions")
    assert product.models == tuple(figure.MODELS)


def test_a_run_without_test_objects_has_its_figure(dataset, models, tmp_path):
    figure.reconstructions(dataset.split("train"), models, tmp_path / "none.png")
    assert Image.open(tmp_path / "none.png").height < 100


def test_one_test_object_of_every_class_is_drawn(dataset):
    """The run has a train and a validation bottle, and a test knife."""
    assert [record.name for record in figure.first_test_objects(dataset)] == ["knife-0000"]
