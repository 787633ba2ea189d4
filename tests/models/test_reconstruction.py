"""The reconstruction against the straightforward implementation, and what must hold whatever its weights."""

import pytest
import torch

from palpate.architectures import Architecture
from palpate.camera import paper_camera
from palpate.charts import ATLAS_RADIUS, sphere, vision_atlas
from palpate.experiments import Experiment
from palpate.mesh import OBJECT_POSITION
from palpate.models import Reconstruction
from tests.models import straightforward
from tests.models.batches import SMALL, random_batch, resized_world, silhouettes, templates

EXPERIMENTS = [
    ("charts", True, True, 1),
    ("charts", True, True, 2),
    ("charts", True, False, 1),
    ("charts", False, True, 5),
    ("no_copy", True, True, 1),
    ("no_comm", True, True, 1),
    ("template", True, True, 2),
    ("template", False, True, 5),
    ("template", True, False, 1),
    ("sphere", True, True, 1),
    ("sphere", True, False, 1),
]
VISION = len(vision_atlas().vertices)


def model_of(strategy, vision, touch, grasps, architecture=SMALL, seed=0):
    torch.manual_seed(seed)
    experiment = Experiment("model", strategy, "occluded" if vision else "none", touch, grasps)
    known = templates(vision)[0] if strategy == "template" else None
    if known and not vision:
        known.least_fit.fill_(0.26)  # between those of two random samples
    return Reconstruction(experiment, Architecture.from_row(architecture), templates=known).double()


def batch_of(samples, strategy, vision, touch, grasps):
    return random_batch(samples, grasps) | (silhouettes(samples) if vision else {})


@pytest.mark.parametrize("experiment", EXPERIMENTS)
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"normalise_positions": False, "init": "paper"},
        {"failed_charts": "fixed", "gcn": SMALL["gcn"] | {"normalisation": "mean"}},
    ],
)
def test_same_vertices_and_gradients_as_the_straightforward_model(experiment, options):
    model = model_of(*experiment, architecture=SMALL | options)
    if model.touch_input == "pooled":
        for weight in (model.touch_pooling, model.touch_attention):
            torch.nn.init.normal_(weight.weight) if weight else None
    batch = batch_of(2, *experiment)
    adjacency = straightforward.dense_adjacency(model.graph)
    direction = torch.randn(2, int(model.faces.max()) + 1, 3, dtype=torch.float64)
    results = []
    for reconstruct in (model, lambda batch: straightforward.reconstruct(model, batch, adjacency)):
        model.zero_grad()
        vertices = reconstruct(batch)
        (vertices * direction).sum().backward()
        results.append((vertices.detach(), {n: p.grad.clone() for n, p in model.named_parameters()}))
    (fast, of_fast), (slow, of_slow) = results
    torch.testing.assert_close(fast, slow, rtol=1e-9, atol=1e-12)
    if model.templates:
        with torch.no_grad():
            closed = model(batch, closed=True), straightforward.reconstruct(model, batch, adjacency, closed=True)
        torch.testing.assert_close(*closed, rtol=1e-9, atol=1e-12)
    for name, gradient in of_slow.items():
        assert gradient.abs().max() > 0, name
        torch.testing.assert_close(of_fast[name], gradient, rtol=1e-7, atol=1e-9, msg=lambda m, n=name: f"{n}: {m}")


def test_gradient_by_finite_differences():
    model = model_of("charts", True, True, 1).eval()
    batch = random_batch(1, 1)

    def vertices(image, charts):
        return model(batch | {"image": image, "charts": charts})[:, ::100]

    image, charts = batch["image"].requires_grad_(), batch["charts"].requires_grad_()
    assert torch.autograd.gradcheck(vertices, (image, charts), fast_mode=True, atol=1e-6)


def test_projected_encoder_is_the_straightforward_one():
    options = SMALL | {"encoder": SMALL["encoder"] | {"norm": "instance", "padding": 1, "project": 7}}
    model, batch = model_of("charts", True, False, 1, architecture=options), random_batch(2, 1)
    slow = straightforward.reconstruct(model, batch, straightforward.dense_adjacency(model.graph))
    torch.testing.assert_close(model(batch), slow, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("grasps", [1, 3])
def test_enforced_charts_are_exactly_the_inputs(grasps):
    model, batch = model_of("charts", True, True, grasps), random_batch(3, grasps)
    charts = model(batch)[:, VISION:].unflatten(1, (4 * grasps, 81))
    success = batch["success"]
    assert torch.equal(charts[success], batch["charts"][success])
    # The others start at the sensor and are moved from there.
    assert (charts[~success] != batch["position"][~success][:, None]).any(dim=2).all()


def test_fixed_charts_of_unsuccessful_touches_stay_at_the_sensor():
    model = model_of("charts", True, True, 1, architecture=SMALL | {"failed_charts": "fixed"})
    batch = random_batch(3, 1)
    vertices = model(batch)
    charts, success = vertices[:, VISION:].unflatten(1, (4, 81)), batch["success"]
    assert torch.equal(charts[success], batch["charts"][success])
    assert torch.equal(charts[~success], batch["position"][~success][:, None].expand(-1, 81, -1))
    # They still inform: where they are changes the other charts.
    moved = model(batch | {"position": batch["position"] + 0.01})
    assert (moved[:, :VISION] != vertices[:, :VISION]).any()


def test_deformations_follow_each_other():
    fixed = SMALL | {"failed_charts": "fixed"}
    twice, once = (model_of("charts", True, True, 1, fixed | {"deformations": count}) for count in (2, 1))
    once.load_state_dict(twice.state_dict())
    batch = random_batch(1, 1)
    middle = once(batch)
    assert (middle[0] != twice(batch)[0]).any()
    once.start = middle[0, :VISION].detach()
    torch.testing.assert_close(once(batch), twice(batch))


def test_without_copying_every_chart_moves():
    model, batch = model_of("no_copy", True, True, 1), random_batch(2, 1)
    charts = model(batch)[:, VISION:].unflatten(1, (4, 81))
    assert (charts != batch["charts"]).any(dim=3).all()


def test_unsuccessful_charts_are_never_read():
    model, batch = model_of("charts", True, True, 1), random_batch(2, 1)
    spoiled = batch["charts"].clone()
    spoiled[~batch["success"]] = torch.nan
    assert torch.equal(model(batch), model(batch | {"charts": spoiled}))


def test_success_is_told_to_the_graph():
    # A successful touch at the very place where an unsuccessful one would stand is another input.
    model, batch = model_of("charts", False, True, 1), random_batch(1, 1)
    batch["charts"] = batch["position"][:, :, None].expand(-1, -1, 81, -1)
    other = batch | {"success": ~batch["success"]}
    assert (model(batch)[:, :VISION] != model(other)[:, :VISION]).any()


def test_touch_reaches_the_vision_charts_only_with_communication():
    batch, other = random_batch(1, 1, seed=0), random_batch(1, 1, seed=1)
    other["image"] = batch["image"]
    for strategy, reached in (("charts", True), ("no_copy", True), ("no_comm", False)):
        model = model_of(strategy, True, True, 1)
        change = model(batch)[:, :VISION] - model(other)[:, :VISION]
        assert bool(change.any()) is reached, strategy


def test_no_comm_appends_the_charts():
    model, batch = model_of("no_comm", True, True, 2), random_batch(2, 2)
    vertices = model(batch)
    charts = vertices[:, VISION:].unflatten(1, (8, 81))
    success = batch["success"]
    assert torch.equal(charts[success], batch["charts"][success])
    assert torch.equal(charts[~success], batch["position"][~success][:, None].expand(-1, 81, -1))
    # Faces: all vertices are used, and those of charts without success have no area.
    assert model.faces.unique().tolist() == list(range(VISION + 8 * 81))
    a, b, c = vertices[0][model.faces].unbind(1)
    area = torch.linalg.norm(torch.linalg.cross(b - a, c - a), dim=1)
    chart = (model.faces[:, 0] - VISION).div(81, rounding_mode="floor")
    for sensor in range(8):
        assert bool((area[chart == sensor] > 0).all()) is bool(success[0, sensor])


@pytest.mark.parametrize("experiment", EXPERIMENTS[:-2])
def test_samples_are_independent_and_permutable(experiment):
    model, batch = model_of(*experiment).eval(), batch_of(3, *experiment)
    together = model(batch)
    order = torch.tensor([2, 0, 1])
    permuted = model({key: value[order] for key, value in batch.items()})
    torch.testing.assert_close(permuted, together[order], rtol=0, atol=1e-12)
    alone = model({key: value[1:2] for key, value in batch.items()})
    torch.testing.assert_close(alone, together[1:2], rtol=0, atol=1e-12)


@pytest.mark.parametrize("strategy", ["charts", "sphere"])
def test_without_residuals_the_start_stays(strategy):
    model = model_of(strategy, True, False, 1, architecture=SMALL | {"last_layer_scale": 0.0})
    start = vision_atlas().vertices if strategy == "charts" else sphere()[0]
    assert torch.equal(model(random_batch(2, 1))[1], start.double())


def test_normalised_positions_are_a_change_of_unit():
    # A residual of one unit in the network is one radius of the atlas in the world.
    model = model_of("charts", True, False, 1, architecture=SMALL | {"last_layer_scale": 0.0})
    with torch.no_grad():
        model.gcn.layers[-1].bias.copy_(torch.tensor([0.5, 0.0, -1.0]))
    moved = model(random_batch(1, 1))[0] - vision_atlas().vertices.double()
    expected = 3 * ATLAS_RADIUS * torch.tensor([0.5, 0.0, -1.0], dtype=torch.float64)
    torch.testing.assert_close(moved, expected.expand(VISION, 3), rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    "experiment", [("charts", True, True, 1), ("sphere", True, True, 1), ("charts", False, True, 2)]
)
def test_in_a_world_of_another_size_the_same_weights_give_the_same_shape(experiment):
    """Objects that keep their size: with its sphere in proportion, the model does not know how large the world is."""
    factor, centre = 0.3, torch.tensor(OBJECT_POSITION, dtype=torch.float64)
    model = model_of(*experiment)
    smaller = model_of(*experiment, architecture=SMALL | {"radius": factor * ATLAS_RADIUS})
    batch, camera = random_batch(2, experiment[3]), paper_camera(40)
    matrix = torch.from_numpy(camera.intrinsics() @ camera.extrinsics()).expand(2, 3, 4)
    expected = centre + factor * (model(batch | {"camera": matrix}) - centre)
    found = smaller(resized_world(batch, matrix, factor))
    assert (expected - smaller(batch | {"camera": matrix})).abs().max() > 0.01
    torch.testing.assert_close(found, expected, rtol=0, atol=1e-6)


def test_every_image_is_looked_up_by_its_own_camera():
    model, batch = model_of("charts", True, False, 1), random_batch(2, 1, size=64)
    turned = batch["camera"].clone()
    turned[0, 0] *= 1.1
    assert (model(batch | {"camera": turned})[0] != model(batch)[0]).any()
    assert torch.equal(model(batch | {"camera": turned})[1], model(batch)[1])
    # Homogeneous: a camera times a number is the same camera.
    torch.testing.assert_close(model(batch | {"camera": 3 * batch["camera"]}), model(batch), rtol=0, atol=1e-9)


def test_the_sphere_feels_position_rotation_success_and_reading():
    model, batch = model_of("sphere", False, True, 1).eval(), random_batch(1, 1)
    before = model(batch)
    for key in ("position", "rotation", "reading"):
        assert (model(batch | {key: batch[key].flip(1)}) != before).any(), key
    # What an unsuccessful sensor reads doesn't matter: stores leave it out.
    empty = batch["reading"] * batch["success"][:, :, None, None, None]
    assert torch.equal(model(batch | {"reading": empty}), before)


def test_no_vertex_in_front_of_the_camera_is_still_a_number():
    model, batch = model_of("charts", True, False, 1), random_batch(1, 1)
    with torch.no_grad():
        model.start += 10 * (torch.tensor(paper_camera().position) - torch.tensor(OBJECT_POSITION))
    vertices = model(batch)
    vertices.square().sum().backward()
    assert torch.isfinite(vertices).all()
    assert all(torch.isfinite(p.grad).all() for p in model.parameters())


def test_bfloat16_stays_close():
    torch.manual_seed(0)
    model = model_of("charts", True, True, 1, SMALL | {"last_layer_scale": 0.01}).float()
    batch = random_batch(1, 1, size=64, dtype=torch.float32)
    exact = model(batch)
    with torch.autocast("cpu", torch.bfloat16):
        rough = model(batch)
    rough.float().sum().backward()
    assert rough.dtype == torch.float32
    assert (rough - exact).abs().max() < 0.05 * (exact - exact.mean(1)).abs().max()
    assert all(p.grad is not None and p.grad.dtype == torch.float32 for p in model.parameters())


@pytest.mark.parametrize(
    ("strategy", "vision", "touch", "grasps", "message"),
    [
        ("charts", False, False, 1, "can't deform charts by vision 'none', touch False"),
        ("no_copy", True, False, 1, "'no_copy' can't deform charts by vision 'occluded', touch False"),
        ("no_comm", False, True, 1, "'no_comm' can't deform charts by vision 'none', touch True"),
        ("charts", True, True, 0, "0 grasps"),
    ],
)
def test_impossible_experiments(strategy, vision, touch, grasps, message):
    with pytest.raises(ValueError, match=message):
        model_of(strategy, vision, touch, grasps)


@pytest.mark.parametrize("key", ["image", "camera", "success", "position", "charts"])
def test_a_missing_key_is_named(key):
    model, batch = model_of("charts", True, True, 1), random_batch(1, 1)
    del batch[key]
    with pytest.raises(ValueError, match=f"no {key}"):
        model(batch)


@pytest.mark.parametrize(
    ("key", "shape", "message"),
    [
        ("image", (2, 40, 40, 3), r"image has shape \(2, 40, 40, 3\), expected \(2, 3, S, S\)"),
        ("image", (2, 3, 40, 44), "image is 40 x 44"),
        ("image", (2, 3, 8, 8), "too small"),
        ("charts", (2, 8, 81, 3), r"charts has shape \(2, 8, 81, 3\), expected \(2, 4, 81, 3\)"),
        ("success", (1, 4), r"success has shape \(1, 4\), expected \(2, 4\)"),
        ("position", (2, 4), "position has shape"),
        ("camera", (3, 4), "camera has shape"),
    ],
)
def test_a_wrong_shape_is_named(key, shape, message):
    model, batch = model_of("charts", True, True, 1), random_batch(2, 1)
    with pytest.raises(ValueError, match=message):
        model(batch | {key: torch.zeros(shape, dtype=torch.float64)})


def test_bytes_are_no_image():
    model, batch = model_of("charts", True, True, 1), random_batch(2, 1)
    with pytest.raises(ValueError, match="image is torch.uint8, expected floating point"):
        model(batch | {"image": (255 * batch["image"]).byte()})
