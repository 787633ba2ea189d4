"""Touch pooling against a loop over vertices and touches, and what must hold whatever the weights."""

import math

import pytest
import torch

from palpate.charts import touch_chart
from palpate.mesh import OBJECT_POSITION
from palpate.models import Reconstruction
from palpate.models.touch import chart_normals, pooled_touch, touched_surface
from tests.models.batches import SMALL, random_batch

POOLED = SMALL | {"touch": "pooled"}


def by_loop(place, charts, success):
    """The features (7,) at one place (3,), from the words of `TouchPooling`, in plain numbers."""
    best, found = math.inf, None
    for chart, touched in zip(charts.tolist(), success.tolist(), strict=True):
        for number, vertex in enumerate(chart if touched else []):
            distance = math.dist(vertex, place.tolist())
            if distance < best:
                best, found = distance, (chart, number)
    if found is None:
        return [0.0] * 7
    chart, number = found
    row, column = divmod(number, 9)

    def difference(step):
        low = 9 * max(row - step[0], 0) + max(column - step[1], 0)
        high = 9 * min(row + step[0], 8) + min(column + step[1], 8)
        return [a - b for a, b in zip(chart[high], chart[low], strict=True)]

    (a, b, c), (d, e, f) = difference((1, 0)), difference((0, 1))
    normal = [b * f - c * e, c * d - a * f, a * e - b * d]
    length = math.hypot(*normal)
    offset = [v - p for v, p in zip(chart[number], place.tolist(), strict=True)]
    near = math.exp(-best / 0.05)
    across = sum(o * n / length for o, n in zip(offset, normal, strict=True))
    return [*(o * near / 0.05 for o in offset), near, math.exp(-best / 0.015), across * near / 0.02, 1.0]


def sheets(samples, touches, seed=0):
    """(B, T, 81, 3) charts like those of sensors: turned sheets with some depth."""
    random = torch.Generator().manual_seed(seed)
    grid = touch_chart().grid.double()
    depth = 0.003 * torch.randn(samples, touches, 81, 1, generator=random, dtype=torch.float64)
    local = torch.cat([depth, grid.expand(samples, touches, -1, -1)], dim=3)
    turn = torch.linalg.qr(torch.randn(samples, touches, 3, 3, generator=random, dtype=torch.float64))[0]
    centre = 0.1 * torch.randn(samples, touches, 1, 3, generator=random, dtype=torch.float64)
    return local @ turn.transpose(2, 3) + centre + torch.tensor(OBJECT_POSITION, dtype=torch.float64)


@pytest.mark.parametrize("success", [[False] * 4, [False, True, False, False], [True] * 20])
def test_pooling_is_the_loop(success):
    charts, touched = sheets(2, len(success)), torch.tensor([success, success[::-1]])
    places = sheets(2, 1, seed=1)[:, 0, ::9].transpose(0, 1)
    pooled = pooled_touch(touched_surface(charts, touched), places)
    expected = [[by_loop(place, charts[sample], touched[sample]) for sample, place in enumerate(row)] for row in places]
    torch.testing.assert_close(pooled, torch.tensor(expected, dtype=torch.float64), rtol=1e-10, atol=1e-12)


def test_gradients_by_finite_differences():
    # Where the nearest vertex is another one, there is a kink: places and vertices at random are not at one.
    charts, touched = sheets(1, 2), torch.tensor([[True, False]])
    places = sheets(1, 1, seed=1)[:, 0, ::20].transpose(0, 1).clone().requires_grad_()

    def pooled(places, charts):
        return pooled_touch(touched_surface(charts, touched), places)

    assert torch.autograd.gradcheck(pooled, (places, charts.requires_grad_()))


def test_a_vertex_on_the_touched_surface():
    charts, touched = sheets(1, 1), torch.ones(1, 1, dtype=torch.bool)
    places = charts[0, 0, 40:41, None].clone().requires_grad_()
    pooled = pooled_touch(touched_surface(charts, touched), places)
    torch.testing.assert_close(pooled[0, 0], torch.tensor([0, 0, 0, 1, 1, 0, 1], dtype=torch.float64))
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


def test_unsuccessful_touches_are_never_read():
    torch.manual_seed(0)
    model = Reconstruction("charts", True, True, 1, POOLED).double()
    torch.nn.init.normal_(model.touch_pooling.weight)
    batch = random_batch(2, 1)
    spoiled = batch["charts"].clone()
    spoiled[~batch["success"]] = torch.nan
    assert torch.equal(model(batch), model(batch | {"charts": spoiled}))


@pytest.mark.parametrize("vision", [True, False])
def test_order_and_number_of_touches(vision):
    torch.manual_seed(0)
    model = Reconstruction("no_copy", vision, True, 5, POOLED).double()
    for name, weight in model.named_parameters():
        if name.startswith("touch"):
            torch.nn.init.normal_(weight)
    batch = random_batch(2, 2)
    order = torch.tensor([3, 0, 7, 1, 6, 2, 5, 4])
    keys = ("success", "position", "rotation", "charts")
    turned = batch | {key: batch[key][:, order] for key in keys}
    torch.testing.assert_close(model(batch), model(turned), rtol=1e-9, atol=1e-12)
    twice = batch | {key: torch.cat([batch[key]] * 2, dim=1) for key in keys}
    torch.testing.assert_close(model(batch), model(twice), rtol=1e-9, atol=1e-12)
