"""Touch pooling against a loop over vertices and touches, and what must hold whatever the weights."""

import math

import pytest
import torch

from palpate.architectures import Architecture
from palpate.charts import touch_chart
from palpate.experiments import Experiment
from palpate.mesh import OBJECT_POSITION
from palpate.models import Reconstruction
from palpate.models.touch import chart_normals, pooled_touches, touches_of
from tests.models.batches import SMALL, random_batch, silhouettes, templates

ARCHITECTURE = Architecture.from_row(SMALL)
VISION = 1824  # vertices of vision charts


def by_loop(place, batch, sample):
    """The features (19,) at one place (3,), from the words of `TouchPooling`, in plain numbers."""
    place = place.tolist()
    best, found, empty_best, empty = math.inf, None, math.inf, [0.0] * 5
    for chart, touched, position, rotation in zip(
        *(batch[key][sample].tolist() for key in ("charts", "success", "position", "rotation")), strict=True
    ):
        if touched:
            for number, vertex in enumerate(chart):
                distance = math.dist(vertex, place)
                if distance < best:
                    best, found = distance, (chart, number)
            continue
        x, y, z = (sum((place[k] - position[k]) * rotation[k][axis] for k in range(3)) for axis in range(3))
        box = (min(max(x, 0), 0.025), *(min(max(w, -0.01641 / 2), 0.01641 / 2) for w in (y, z)))
        distance = math.dist((x, y, z), box)
        if distance < empty_best:
            empty_best, e = distance, math.exp(-distance / 0.01)
            empty = [e, *(rotation[k][0] * e for k in range(3)), x / 0.025 * e]
    if found is None:
        return [0.0] * 14 + empty
    chart, number = found
    row, column = divmod(number, 9)

    def difference(step):
        low = 9 * max(row - step[0], 0) + max(column - step[1], 0)
        high = 9 * min(row + step[0], 8) + min(column + step[1], 8)
        return [a - b for a, b in zip(chart[high], chart[low], strict=True)]

    (a, b, c), (d, e, f) = difference((1, 0)), difference((0, 1))
    normal = [b * f - c * e, c * d - a * f, a * e - b * d]
    normal = [n / math.hypot(*normal) for n in normal]
    offset = [v - p for v, p in zip(chart[number], place, strict=True)]
    w, v = math.exp(-best / 0.05), math.exp(-best / 0.15)
    across = sum(o * n for o, n in zip(offset, normal, strict=True))
    near = [*(o * w / 0.05 for o in offset), w, math.exp(-best / 0.015), across * w / 0.02, *(n * w for n in normal)]
    return [*near, *(o * v / 0.15 for o in offset), v, 1.0, *empty]


def sheets(samples, touches, seed=0):
    """(B, T, 81, 3) charts like those of sensors: turned sheets with some depth."""
    random = torch.Generator().manual_seed(seed)
    grid = touch_chart().grid.double()
    depth = 0.003 * torch.randn(samples, touches, 81, 1, generator=random, dtype=torch.float64)
    local = torch.cat([depth, grid.expand(samples, touches, -1, -1)], dim=3)
    turn = torch.linalg.qr(torch.randn(samples, touches, 3, 3, generator=random, dtype=torch.float64))[0]
    centre = 0.1 * torch.randn(samples, touches, 1, 3, generator=random, dtype=torch.float64)
    return local @ turn.transpose(2, 3) + centre + torch.tensor(OBJECT_POSITION, dtype=torch.float64)


def touches(success, seed=0):
    """A batch of touches like those of sensors, some of which are in the sensors' reach."""
    success = torch.tensor(success)
    charts = sheets(*success.shape, seed=seed)
    random = torch.Generator().manual_seed(seed + 10)
    rotation = torch.linalg.qr(torch.randn(*success.shape, 3, 3, generator=random, dtype=torch.float64))[0]
    return {"success": success, "charts": charts, "position": charts.mean(2), "rotation": rotation}


@pytest.mark.parametrize("success", [[False] * 4, [False, True, False, False], [True] * 20, [True, False] * 10])
def test_pooling_is_the_loop(success):
    batch = touches([success, success[::-1]])
    places = sheets(2, 1, seed=1)[:, 0, ::9].transpose(0, 1).clone()
    # Two in the reach of the first sensor, 1 cm before it, and behind it.
    ahead = batch["rotation"][:, 0, :, 0]
    places[0], places[1] = batch["position"][:, 0] + 0.01 * ahead, batch["position"][:, 0] - 0.005 * ahead
    pooled = pooled_touches(touches_of(batch), places)
    expected = [[by_loop(place, batch, sample) for sample, place in enumerate(row)] for row in places]
    torch.testing.assert_close(pooled, torch.tensor(expected, dtype=torch.float64), rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("success", [[False, False], [True, False], [True] * 20])
def test_gradients_by_finite_differences(success):
    # Where another vertex or box becomes the nearest there is a kink: places at random are not at one.
    batch = touches([success])
    places = sheets(1, 1, seed=1)[:, 0, ::20].transpose(0, 1).clone().requires_grad_()

    def pooled(places, charts, position):
        return pooled_touches(touches_of(batch | {"charts": charts, "position": position}), places)

    charts, position = batch["charts"].requires_grad_(), batch["position"].requires_grad_()
    assert torch.autograd.gradcheck(pooled, (places, charts, position), fast_mode=True)


def test_a_vertex_on_the_touched_surface():
    batch = touches([[True]])
    places = batch["charts"][0, 0, 40:41, None].clone().requires_grad_()
    pooled = pooled_touches(touches_of(batch), places)
    expected = torch.zeros(19, dtype=torch.float64)
    expected[[3, 4, 12, 13]] = 1
    expected[6:9] = chart_normals(batch["charts"])[0, 0, 40]
    torch.testing.assert_close(pooled[0, 0], expected)
    pooled.sum().backward()
    assert torch.isfinite(places.grad).all()


def test_a_vertex_within_a_sensors_reach():
    batch = touches([[False]])
    places = (batch["position"] + 0.01 * batch["rotation"][..., 0]).requires_grad_()
    pooled = pooled_touches(touches_of(batch), places)
    torch.testing.assert_close(pooled[0, 0, 14:15], torch.ones(1, dtype=torch.float64))
    torch.testing.assert_close(pooled[0, 0, 15:18], batch["rotation"][0, 0, :, 0])
    torch.testing.assert_close(pooled[0, 0, 18], torch.tensor(0.4, dtype=torch.float64))
    pooled.sum().backward()
    assert torch.isfinite(places.grad).all()


def test_normals_of_a_plane_face_the_sensor():
    grid = touch_chart().grid.double()
    flat = torch.cat([torch.full((81, 1), 0.01, dtype=torch.float64), grid], dim=1)  # depth along the sensor's x
    towards = torch.tensor([-1.0, 0, 0], dtype=torch.float64)
    torch.testing.assert_close(chart_normals(flat), towards.expand(81, 3))
    # The same side as the chart's faces look to.
    a, b, c = flat[touch_chart().faces[0]]
    assert torch.linalg.cross(b - a, c - a) @ towards > 0


def model_of(vision, grasps):
    """A model whose touches are pooled, with weights that start at zero at random."""
    torch.manual_seed(0)
    experiment = Experiment("model", "template", "occluded" if vision else "none", True, grasps)
    model = Reconstruction(experiment, ARCHITECTURE, templates=templates(vision)[0]).double()
    for name, weight in model.named_parameters():
        if name.startswith("touch"):
            torch.nn.init.normal_(weight)
    return model


def test_unsuccessful_touches_are_never_read():
    model, batch = model_of(True, 1), random_batch(2, 1) | silhouettes(2)
    spoiled = batch["charts"].clone()
    spoiled[~batch["success"]] = torch.nan
    assert torch.equal(model(batch), model(batch | {"charts": spoiled}))


@pytest.mark.parametrize("vision", [True, False])
def test_order_and_number_of_touches(vision):
    """Of vision charts from the same start."""
    model, start = model_of(vision, 5), sheets(2, 23).flatten(1, 2)[:, :VISION]
    batch = random_batch(2, 2) | (silhouettes(2) if vision else {}) | {"start": start.transpose(0, 1)}
    order = torch.tensor([3, 0, 7, 1, 6, 2, 5, 4])
    keys = ("success", "position", "rotation", "charts")
    turned = batch | {key: batch[key][:, order] for key in keys}
    found = model(batch)[:, :VISION]
    torch.testing.assert_close(found, model(turned)[:, :VISION], rtol=1e-9, atol=1e-12)
    twice = batch | {key: torch.cat([batch[key]] * 2, dim=1) for key in keys}
    torch.testing.assert_close(found, model(twice)[:, :VISION], rtol=1e-9, atol=1e-12)


def test_a_sample_with_fewer_grasps_has_fewer_charts_in_its_mesh():
    model, batch = model_of(False, 5), random_batch(1, 2)
    vertices, ((shown, faces),) = model(batch), model.meshes(batch)
    assert len(shown) == VISION + 8 * 81 and len(faces) == 2304 + 8 * 128
    assert faces.unique().tolist() == list(range(len(shown)))
    assert model.sample(vertices, {}, 10, torch.Generator().manual_seed(0)).shape == (1, 10, 3)


def test_a_place_that_is_no_number_has_no_numbers():
    batch = touches([[True, False]])
    places = torch.full((3, 1, 3), torch.nan, dtype=torch.float64)
    assert torch.isnan(pooled_touches(touches_of(batch), places)[..., :13]).all()
