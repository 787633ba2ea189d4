from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
import yaml
from PIL import Image

from palpate.architectures import Architecture
from palpate.charts import touch_chart, vision_atlas
from palpate.evaluation.reconstruct import TOUCH_COLOUR, VISION_COLOUR, Shape
from palpate.experiments import Experiment
from palpate.inference import checkpoints
from palpate.mesh import OBJECT_POSITION
from palpate.models import TouchDepth
from palpate.results import products
from palpate.results import reconstructions as figure
from palpate.results.page import DPI
from palpate.vision import Mesh, Renderer, looking_at, paper_camera
from tests.models.batches import SMALL

PROJECT = Path(__file__).parents[2]
EXPERIMENTS = {
    each.name: each for each in (Experiment("pooled_touch_any", "pooled", "none", True, 2, fewer_grasps=True),)
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
        model = checkpoints.build(experiment, Architecture.from_row(SMALL))
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


def test_colours_are_where_the_charts_project():
    """The atlas, and one touch chart before it: orange where that projects, blue around it, white outside."""
    atlas, chart = vision_atlas(), touch_chart()
    camera = figure.shared_camera(120)
    towards = camera.position - OBJECT_POSITION
    towards /= np.linalg.norm(towards)
    right = np.cross([0, 0, 1], towards)
    axes = np.stack([right / np.linalg.norm(right), np.cross(towards, right / np.linalg.norm(right))])
    sheet = OBJECT_POSITION + 0.3 * towards + 8 * chart.grid.numpy() @ axes
    shape = Shape(
        np.concatenate([atlas.vertices.numpy(), sheet]),
        np.concatenate([atlas.faces.numpy(), chart.faces.numpy() + len(atlas.vertices)]),
        np.repeat([False, True], [len(atlas.faces), len(chart.faces)]),
    )
    drawn = Renderer(samples=4).render_meshes([figure.coloured(shape)], camera=camera).rgb

    def at(points):
        column, row = camera.project(points)[0].astype(int).T
        return hue(drawn[row, column])

    inside = OBJECT_POSITION + 0.3 * towards + 7 * chart.grid.numpy() @ axes
    assert (at(inside) == 1).all()
    around = OBJECT_POSITION + 0.26 * towards + 13 * chart.grid.numpy()[[0, 4, 8, 36, 44, 72, 80]] @ axes
    assert (at(around) == -1).all()
    corners = drawn[[0, 0, -1, -1], [0, -1, 0, -1]]
    assert (corners > 250).all()
    assert hue(np.array(TOUCH_COLOUR) * 255) == 1 and hue(np.array(VISION_COLOUR) * 255) == -1


@pytest.mark.parametrize("images", [paper_camera(256), looking_at(OBJECT_POSITION, (-0.7, 1.1, 0.2), 256, 50)])
def test_images_are_cut_to_what_the_renders_show(images):
    rng = np.random.default_rng(0)
    points = OBJECT_POSITION + rng.uniform(-0.2, 0.2, size=(50, 3))
    low, high = figure.frame(256)
    of_image = (images.project(points)[0] - low) / (high - low)
    seen = figure.shared_camera(90, images=images).project(points)[0]
    np.testing.assert_allclose(of_image, seen / 90, atol=1e-9)


def sphere_of_points(radius: float, spikes=()) -> Mesh:
    """A sphere around the object's centre, with single triangles that reach out to some points."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=radius)
    vertices, faces = ball.vertices + OBJECT_POSITION, ball.faces
    for spike in spikes:
        tip = np.array([spike, [spike[0] + 1e-3, *spike[1:]], OBJECT_POSITION])
        faces = np.vstack([faces, len(vertices) + np.arange(3)])
        vertices = np.vstack([vertices, tip])
    return Mesh(vertices, faces)


def test_the_camera_of_a_row_shows_every_mesh_of_it():
    """A small object is seen as near as `ZOOM`; beside a large prediction all move away, until it is in the picture;
    a single spike moves no camera."""
    assert figure.zoom_of([sphere_of_points(0.1)]) == figure.ZOOM
    large = sphere_of_points(0.4)
    zoom = figure.zoom_of([sphere_of_points(0.1), large])
    assert zoom < figure.ZOOM
    pixels, _ = figure.shared_camera(100, zoom).project(large.vertices)
    inside = ((pixels > 0) & (pixels < 100)).all(axis=1)
    assert inside.mean() >= figure.SHOWN and np.quantile(np.abs(pixels - 50).max(axis=1), figure.SHOWN) > 45
    spiked = sphere_of_points(0.1, spikes=[[0.0, 0.0, 3.0]])
    assert figure.zoom_of([spiked]) == figure.ZOOM


def test_vertices_outside_the_picture_are_marked_at_its_edge():
    """On the line from the picture's middle; the points of charts without a touch are none of them."""
    camera = figure.shared_camera(100)
    centre = camera.project(np.array(OBJECT_POSITION))[0]
    assert figure.marks(sphere_of_points(0.1), camera)[1] == 0
    mesh = sphere_of_points(0.1, spikes=[[0.0, 0.0, 1.3]])
    edge, outside = figure.marks(mesh, camera)
    assert outside == 2 and (edge[:, 1] == 0).all() and (np.abs(edge[:, 0] - centre[0]) < 10).all()
    point = Mesh(np.vstack([mesh.vertices, [[5.0, 5.0, 0.6]]]), np.vstack([mesh.faces, [len(mesh.vertices)] * 3]))
    assert figure.marks(point, camera)[1] == 2
    behind = sphere_of_points(0.1, spikes=[np.array(camera.position) * 1.5])
    assert figure.marks(behind, camera)[1] == 2


def test_wires_are_the_sides_that_nothing_hides():
    """Of a sphere, those of the half that faces the camera."""
    camera, mesh = figure.shared_camera(120), sphere_of_points(0.15)
    depth = Renderer(samples=1).render_meshes([mesh], camera=camera).depth
    shown = figure.visible_sides(mesh, camera, depth)
    ends = mesh.vertices[trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).edges_unique]
    facing = ((ends.mean(axis=1) - OBJECT_POSITION) * (camera.position - ends.mean(axis=1))).sum(axis=1)
    assert len(shown) == pytest.approx((facing > 0).sum(), rel=0.15)
    assert ((shown > 0) & (shown < 120)).all()


def test_ground_truth_is_the_objects_surface_in_the_world(dataset):
    record = dataset["knife-0000"]
    mesh = figure.ground_truth(record)
    low, high = record.points.min(axis=0), record.points.max(axis=0)
    np.testing.assert_allclose(np.min(mesh.vertices, axis=0), low, atol=0.005)
    np.testing.assert_allclose(np.max(mesh.vertices, axis=0), high, atol=0.005)


def test_ground_truth_without_meshes_is_of_points(dataset):
    class Released:
        mesh = dataset["knife-0000"].mesh.parent / "nothing"
        points = dataset["knife-0000"].points

    mesh = figure.ground_truth(Released)
    assert np.abs(np.min(mesh.vertices, axis=0) - Released.points.min(axis=0)).max() < 0.005


def test_one_test_object_of_every_class_is_drawn(dataset):
    """The run has a train and a validation bottle, and a test knife."""
    assert [record.name for record in figure.test_objects(dataset)] == ["knife-0000"]


def test_every_number_of_grasps_has_its_column(dataset, models, tmp_path, small, monkeypatch):
    monkeypatch.setitem(figure.MODELS, "pooled_touch_any", ("Touch only", (1, 2)))
    figure.reconstructions(dataset, models, tmp_path / "a.png")
    figure.reconstructions(dataset, models, tmp_path / "b.png")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    monkeypatch.setitem(figure.MODELS, "pooled_touch_any", ("Touch only", (1,)))
    figure.reconstructions(dataset, models, tmp_path / "one.png", wires=True)
    two, one = (np.asarray(Image.open(tmp_path / f"{n}.png").convert("RGB")) for n in ("a", "one"))
    cell = 1.32 * DPI
    assert two.shape[1] - one.shape[1] == pytest.approx(cell, abs=1)
    body = two[round(0.5 * DPI) :]
    for number in range(2):  # from the right: blue spheres; input images and ground truth are grey
        panel = body[:, round(two.shape[1] - (number + 1) * cell) : round(two.shape[1] - number * cell)]
        assert 0.1 < (hue(panel) == -1).mean() < 0.9
    assert (hue(body[:, : round(two.shape[1] - 2 * cell) - 5]) == 0).all()


def test_every_column_has_an_experiment_and_its_model_in_the_rule():
    known = yaml.safe_load((PROJECT / "config/experiments.yaml").read_text())["experiments"]
    assert set(figure.MODELS) <= set(known)
    product, _ = products.find("figures", "reconstructions")
    assert product.models == tuple(figure.MODELS)


def test_an_experiment_without_a_column_is_an_error(dataset, models, tmp_path):
    with pytest.raises(ValueError, match="no column for sphere_touch: expected some of pooled_occluded_any,"):
        figure.reconstructions(dataset, {"sphere_touch": models["pooled_touch_any"]}, tmp_path / "x.png")


def test_a_run_without_test_objects_has_its_figure(dataset, models, tmp_path):
    figure.reconstructions(dataset.split("train"), models, tmp_path / "none.png")
    assert Image.open(tmp_path / "none.png").height < 100
