"""The published single-image networks: what they predict where, and the surface of a grid of values."""

import numpy as np
import pytest
import torch
import trimesh
from torch.nn import functional

from palpate.architectures import PAPER_ARCHITECTURES, SINGLE_IMAGE_ARCHITECTURES, Architecture
from palpate.camera import paper_camera
from palpate.charts import ATLAS_RADIUS, sphere
from palpate.mesh import OBJECT_POSITION
from palpate.models import SINGLE_IMAGE_MODELS
from palpate.models.losses import CELL, occupied
from palpate.models.pooling import pool, relative_camera
from palpate.models.single_image import DeformedSphere, PointSet, Voxels, grid_surface, view_axes
from palpate.vision import views
from tests.models.batches import SMALL, random_batch, resized_world

ENCODER = SMALL["encoder"] | {"padding": 1, "norm": "instance"}
ARCHITECTURES = {
    "psg": {"encoder": ENCODER, "decoder": {"hidden": 12, "points": 7}},
    "pixel2mesh": SMALL | {"encoder": ENCODER},
    "r2n2": {"encoder": ENCODER, "decoder": {"hidden": 12, "channels": [6, 5, 4, 3], "level": 0.4}},
}
SIZE = 21
CENTRE = torch.tensor(OBJECT_POSITION, dtype=torch.float64)


def batch(samples: int = 2) -> dict[str, torch.Tensor]:
    """Random images, each with the camera of a view from somewhere else."""
    at = views.viewpoints(np.random.default_rng(0), samples)
    cameras = np.stack([views.camera(viewpoint, SIZE).matrix() for viewpoint in at])
    return {"image": random_batch(samples, 1, size=SIZE)["image"], "camera": torch.from_numpy(cameras)}


def built(strategy: str, **changed):
    torch.manual_seed(0)
    return SINGLE_IMAGE_MODELS[strategy](Architecture.from_row(ARCHITECTURES[strategy] | changed)).double()


@pytest.mark.parametrize(
    ("strategy", "shapes"),
    # Of 21 pixels the first map has 11 cells an edge; the sphere has 1154 vertices, and three blocks deform it.
    [("psg", [(2, 7 + 11 * 11, 3)]), ("pixel2mesh", [(2, 1154, 3)] * 3), ("r2n2", [(2, 32, 32, 32)])],
)
def test_shapes_and_gradients(strategy, shapes):
    model, images = built(strategy), batch()
    stages = model.stages(images)
    assert [tuple(stage.shape) for stage in stages] == shapes
    assert torch.equal(model(images), stages[-1])
    sum(stage.square().sum() for stage in stages).backward()
    for name, weights in model.named_parameters():
        assert weights.grad is not None and weights.grad.abs().sum() > 0, name


@pytest.mark.parametrize("strategy", SINGLE_IMAGE_MODELS)
def test_a_sample_does_not_depend_on_the_others_of_its_batch(strategy):
    model, images = built(strategy), batch(3)
    together = model(images)
    for k in range(3):
        alone = model({key: value[k : k + 1] for key, value in images.items()})
        torch.testing.assert_close(alone[0], together[k])
    assert (together[0] - together[1]).abs().max() > 1e-4


@pytest.mark.parametrize("strategy", SINGLE_IMAGE_MODELS)
def test_what_is_missing_or_of_another_shape_is_named(strategy):
    model, images = built(strategy), batch()
    with pytest.raises(ValueError, match="image has shape \\(\\)"):
        model({"camera": images["camera"]})
    with pytest.raises(ValueError, match="expected \\(B, 3, S, S\\)"):
        model(images | {"image": images["image"][..., 1:]})
    with pytest.raises(ValueError, match="camera has shape \\(1, 3, 4\\), expected \\(2, 3, 4\\)"):
        model(images | {"camera": images["camera"][:1]})


def test_the_axes_of_a_view():
    """Those of the camera that the projection is made of; Blender's camera looks along its -z, y up."""
    cameras = [*(views.camera(at, SIZE) for at in views.viewpoints(np.random.default_rng(3), 4)), paper_camera()]
    matrices = torch.from_numpy(np.stack([camera.matrix() for camera in cameras]))
    for axes, camera in zip(view_axes(matrices).numpy(), cameras, strict=True):
        expected = np.asarray(camera.rotation).T * np.array([[1], [-1], [-1]])
        np.testing.assert_allclose(axes, expected, atol=1e-9)


def test_points_turn_with_the_view():
    """The same image seen from elsewhere: the same points in the view's frame, about the object."""
    model, images = built("psg"), batch()
    images["image"] = images["image"][:1].expand(2, -1, -1, -1)
    seen = [(points - CENTRE) @ axes.T for points, axes in zip(model(images), view_axes(images["camera"]), strict=True)]
    torch.testing.assert_close(*seen)
    points = model(images)
    assert (points[0] - points[1]).abs().max() > 0.01
    assert torch.equal(model.sample(points, {}, 5), points)  # as they are
    vertices, faces = model.mesh(points[0])
    assert torch.equal(vertices, points[0]) and faces.shape == (0, 3)


def test_points_of_the_map_are_seen_by_the_deconvolutions():
    """Two levels by hand, from the module's own weights."""
    model, images = built("psg"), batch()
    first, last = model.encoder(images["image"])
    up, skip, mix = model.up[0], model.skip[0], model.mix[0]
    x = functional.conv_transpose2d(last, up.weight, up.bias, stride=2, padding=1)
    x = torch.relu(x + functional.conv2d(first, skip.weight, skip.bias, padding=1))
    x = torch.relu(functional.conv2d(x, mix.weight, mix.bias, padding=1))
    x = functional.conv2d(x, model.cells.weight, model.cells.bias, padding=1)
    for k, axes in enumerate(view_axes(images["camera"])):
        naive = [x[k, :, row, column] for row in range(11) for column in range(11)]
        expected = ATLAS_RADIUS * torch.stack(naive) @ axes + CENTRE
        torch.testing.assert_close(model(images)[k, 7:], expected)


def test_each_block_of_the_sphere_sees_where_the_last_one_left_the_vertices():
    model, images = built("pixel2mesh", last_layer_scale=1.0), batch()
    assert torch.equal(model.start.float(), sphere()[0])
    camera, maps = relative_camera(images["camera"], SIZE), model.encoder(images["image"])
    before = model.start.expand(2, -1, -1)
    for block, after in zip(model.blocks, model.stages(images), strict=True):
        pooled = pool(maps, before.transpose(0, 1), camera)
        inputs = torch.cat([pooled, ((before - CENTRE) / ATLAS_RADIUS).transpose(0, 1)], dim=2)
        moved = before + ATLAS_RADIUS * block(inputs, model.graph).transpose(0, 1)
        torch.testing.assert_close(after, moved)
        assert (after - before).abs().max() > 1e-3
        before = after


def test_edges_are_those_of_the_closed_sphere():
    model = built("pixel2mesh")
    mesh = trimesh.Trimesh(model.start.numpy(), model.faces.numpy(), process=False)
    assert {tuple(edge) for edge in model.edges.tolist()} == {tuple(edge) for edge in mesh.edges_unique.tolist()}
    assert len(model.edges) == len(mesh.edges_unique) == 1154 + 2304 - 2  # Euler


def ball(radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Signed depth (32, 32, 32) of the cells' centres within a ball off the grid's centre, and its centre."""
    shift = np.array([0.02, -0.01, 0.03])
    line = (np.arange(32) + 0.5) * CELL - 0.25
    places = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1)
    return radius - np.linalg.norm(places - shift, axis=-1), shift + OBJECT_POSITION


def test_the_surface_of_a_ball():
    """Values that fall linearly through the level at the radius: area, volume and centre in closed form."""
    radius = 0.14
    depth, centre = ball(radius)
    vertices, faces = grid_surface(np.clip(0.5 + depth / (4 * CELL), 0, 1), 0.5)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert mesh.is_watertight and mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * radius**3, rel=0.01)  # positive: faces look outwards
    assert mesh.area == pytest.approx(4 * np.pi * radius**2, rel=0.01)
    np.testing.assert_allclose(np.linalg.norm(vertices - centre, axis=1), radius, atol=0.02 * CELL)
    np.testing.assert_allclose(mesh.center_mass, centre, atol=0.01 * CELL)


def test_a_grid_that_is_full_is_closed():
    mesh = trimesh.Trimesh(*grid_surface(np.ones((32, 32, 32)), 0.5), process=False)
    # Level 0.5 lies half a cell beyond the outermost centres: the grid's own sides, without edges and corners.
    np.testing.assert_allclose(mesh.bounds - OBJECT_POSITION, [[-0.25] * 3, [0.25] * 3], atol=1e-9)
    assert mesh.is_watertight and mesh.volume == pytest.approx(0.5**3, rel=0.02)


@pytest.mark.parametrize("level", [0.4, 0.9])
def test_predicted_cells_are_measured_on_their_surface(level):
    radius = 0.14
    depth, centre = ball(radius)
    model = built("r2n2", decoder=ARCHITECTURES["r2n2"]["decoder"] | {"level": level})
    # Log-odds of a probability that reaches the level at the radius, and is nearly linear between two cells there.
    odds = torch.from_numpy(np.log(level / (1 - level)) + depth / (8 * CELL))
    points = model.sample(odds[None], {}, 4000, torch.Generator().manual_seed(0))
    assert points.shape == (1, 4000, 3)
    away = (points[0] - torch.from_numpy(centre)).norm(dim=1)
    assert float((away - radius).abs().max()) < 0.05 * CELL
    # Uniform by area: the mean of the height over a sphere is its centre's.
    assert (points[0].mean(dim=0) - torch.from_numpy(centre)).abs().max() < 4 * radius / np.sqrt(3 * 4000)


def test_a_prediction_that_nowhere_reaches_the_level_has_a_surface():
    depth, _ = ball(0.14)
    model = built("r2n2")
    faint = torch.from_numpy(-12 + depth / CELL)
    assert faint.max().sigmoid() < 0.4
    vertices, faces = model.mesh(faint)
    mesh = trimesh.Trimesh(vertices.numpy(), faces.numpy(), process=False)
    assert len(faces) and mesh.is_watertight
    index = ((vertices.numpy() - OBJECT_POSITION) / CELL + 15.5).round().astype(int)
    # Around the most probable cells: half their probability, within a cell.
    assert depth[tuple(index.T)].min() > depth.max() - 3 * CELL


def test_occupied_cells_against_a_naive_count():
    """A ball's points: cells that hold one, and those enclosed. Cells far inside are, those outside are not."""
    radius = 0.14
    depth, centre = ball(radius)
    directions = np.random.default_rng(0).standard_normal((20_000, 3))
    points = centre + radius * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    found = occupied(torch.from_numpy(points)).numpy()
    naive = np.zeros((32, 32, 32), dtype=bool)
    for x, y, z in points:
        corner = [
            int((value - middle + 0.25) // CELL) for value, middle in zip((x, y, z), OBJECT_POSITION, strict=True)
        ]
        naive[tuple(corner)] = True
    assert found[naive].all()
    assert found[depth > 0].all() and not found[depth < -CELL * np.sqrt(3) / 2].any()


def test_an_open_sheet_encloses_nothing():
    grid = torch.linspace(-0.2, 0.2, 200, dtype=torch.float64)
    sheet = torch.stack([*torch.meshgrid(grid, grid, indexing="ij"), torch.full((200, 200), 0.01)], dim=2)
    found = occupied(sheet.reshape(-1, 3) + CENTRE)
    assert found.any(dim=1).any(dim=0).sum() == 1  # one layer of cells along z


def test_points_on_the_grids_edge_stay_in_it():
    corners = torch.tensor([[-0.25] * 3, [0.25] * 3], dtype=torch.float64) + CENTRE
    found = occupied(corners).nonzero()
    assert found.tolist() == [[0, 0, 0], [31, 31, 31]]


@pytest.mark.parametrize("strategy", SINGLE_IMAGE_MODELS)
def test_in_a_world_of_another_size_the_same_weights_give_the_same_shape(strategy):
    factor, images = 2.5, batch()
    model, larger = built(strategy), built(strategy, radius=2.5 * ATLAS_RADIUS)
    (before, faces), (after, same) = (
        each.mesh(each(resized_world(images, images["camera"], size))[0].detach())
        for each, size in ((model, 1), (larger, factor))
    )
    assert torch.equal(faces, same)
    torch.testing.assert_close(after, CENTRE + factor * (before - CENTRE), rtol=0, atol=3e-6)


def test_cells_are_of_the_grids_size():
    points = torch.from_numpy(np.random.default_rng(0).uniform(-0.2, 0.2, (300, 3))) + CENTRE
    assert torch.equal(occupied(3 * (points - CENTRE) + CENTRE, 3.0), occupied(points))


def test_the_decoder_must_end_at_32_cells():
    with pytest.raises(ValueError, match="grids of 4, 8, 16 and 32"):
        built("r2n2", decoder={"hidden": 4, "channels": [4, 4], "level": 0.5})


def test_the_published_sizes_on_the_papers_encoder():
    """256 points fully connected (PSG), 14 layers a block (Pixel2Mesh), a vector of 1024 and 4^3 cells (3D-R2N2)."""
    models = {name: SINGLE_IMAGE_MODELS[name](layers) for name, layers in SINGLE_IMAGE_ARCHITECTURES.items()}
    assert isinstance(models["psg"], PointSet) and models["psg"].points.out_features == 3 * 256
    assert isinstance(models["pixel2mesh"], DeformedSphere)
    assert [len(block.layers) for block in models["pixel2mesh"].blocks] == [14] * 3
    assert isinstance(models["r2n2"], Voxels) and models["r2n2"].base.in_features == 1024
    encoder = PAPER_ARCHITECTURES["single_image"].encoder
    assert all(len(model.encoder.layers) == sum(encoder.layers) for model in models.values())
    images = {"image": torch.rand(1, 3, 137, 137), "camera": batch(1)["camera"].float()}
    with torch.inference_mode():
        shapes = {name: tuple(model(images).shape) for name, model in models.items()}
    assert shapes == {"psg": (1, 256 + 35 * 35, 3), "pixel2mesh": (1, 1154, 3), "r2n2": (1, 32, 32, 32)}


@pytest.mark.parametrize("wrong", [{"padding": 0}, {"layers": [1, 2], "pool": [2, 3]}])
def test_the_points_need_maps_that_halve(wrong):
    with pytest.raises(ValueError, match="half as wide"):
        built("psg", encoder=ENCODER | wrong)
