"""Fits of touch charts against surfaces whose form is known."""

from fractions import Fraction

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from palpate.charts import chamfer_distance, fit_atlas, fit_direct, sample_faces, sphere, touch_chart
from palpate.charts.fit import spread
from palpate.protocol import CHAMFER_SCALE
from palpate.touch import PIXEL_CENTRES, SENSOR_WIDTH, local_points

Y, Z = (torch.from_numpy(grid) for grid in np.meshgrid(PIXEL_CENTRES, PIXEL_CENTRES))
ALL = torch.ones(100, 100, dtype=torch.bool)


def poses(k, seed=0):
    rotation = torch.from_numpy(Rotation.random(k, random_state=seed).as_matrix())
    return torch.from_numpy(np.random.default_rng(seed).normal(size=(k, 3))), rotation


def surfaces():
    """Depths and masks: a slope, a ball, a thin slanted rod, a few pixels."""
    slope = 0.02 + 0.1 * Y - 0.2 * Z
    square = 0.02**2 - Y**2 - Z**2
    ball = 0.035 - square.clamp(min=0).sqrt()
    aslant = (Y - Z) / 2**0.5
    rod = 0.022 - (0.003**2 - aslant**2).clamp(min=0).sqrt()
    few = (Y.abs() < 3e-4) & (Z > 0.0078)
    return torch.stack([slope, ball, rod, slope]), torch.stack([ALL, ball < 0.0215, aslant.abs() < 0.0028, few])


def clouds(depth, valid, position, rotation):
    """By the dataset's own function for clouds."""
    depth = torch.where(valid, depth, torch.inf)
    each = zip(depth.numpy(), position.numpy(), rotation.numpy(), strict=True)
    return [torch.from_numpy(local_points(*one)).double() for one in each]


def error(charts, truth, n=4000):
    """In the tables' unit."""
    sampled = sample_faces(charts, touch_chart().faces, n, torch.Generator().manual_seed(0))
    return chamfer_distance(sampled, truth) * CHAMFER_SCALE


def test_direct_fit_follows_known_surfaces():
    depth, valid = surfaces()
    position, rotation = poses(4)
    charts = fit_direct(depth, valid, position, rotation)
    assert charts.shape == (4, 81, 3) and charts.dtype == torch.float64
    # 4,000 points leave about 0.0002 by themselves on a whole sensor plane, less on a smaller contact.
    assert (error(charts, clouds(depth, valid, position, rotation)) < 0.0006).all()


def test_vertices_of_the_direct_fit_are_points_of_the_cloud_in_the_charts_order():
    depth, valid = surfaces()
    position, rotation = poses(4, seed=1)
    charts = fit_direct(depth, valid, position, rotation)
    for chart, points in zip(charts, clouds(depth, valid, position, rotation), strict=True):
        assert torch.cdist(chart, points).min(dim=1).values.max() < 1e-6
    local = ((charts - position[:, None]) @ rotation).reshape(4, 9, 9, 3)
    assert (local[:, :, :, 1].diff(dim=2) >= 0).all()  # y along columns
    assert (local[:, :, :, 2].diff(dim=1) >= 0).all()  # z along rows
    # Where the whole plane is in contact, the chart is the sheet, half a pixel smaller on each side.
    sheet = touch_chart().grid.double().reshape(9, 9, 2)
    assert (local[0, :, :, 1:] - sheet).abs().max() < SENSOR_WIDTH / 100 * 1.01


def test_contact_without_a_gap_is_covered_to_its_ends():
    depth, valid = surfaces()
    position, rotation = (
        torch.zeros(4, 3, dtype=torch.float64),
        torch.eye(3, dtype=torch.float64).repeat(4, 1, 1),
    )
    charts = fit_direct(depth, valid, position, rotation)
    for chart, points in zip(charts, clouds(depth, valid, position, rotation), strict=True):
        torch.testing.assert_close(chart[:, 2].min().item(), points[:, 2].min().item(), atol=1e-6, rtol=0)
        torch.testing.assert_close(chart[:, 2].max().item(), points[:, 2].max().item(), atol=1e-6, rtol=0)


@settings(max_examples=60, deadline=None)
@given(mask=st.lists(st.booleans(), min_size=1, max_size=30), count=st.integers(2, 12))
def test_spread_is_even_over_the_true_entries(mask, count):
    found = spread(torch.tensor(mask)[None], count)[0]
    true = np.flatnonzero(mask)
    if not len(true):
        assert (found == 0).all()
        return
    ranks = np.searchsorted(true, found)
    assert true[ranks].tolist() == found.tolist()
    # The nearest rank, exactly; either one of a place half-way between two.
    even = [Fraction(k * (len(true) - 1), count - 1) for k in range(count)]
    assert all(abs(int(rank) - place) <= Fraction(1, 2) for rank, place in zip(ranks, even, strict=True))


@pytest.mark.parametrize("pixels", [[(0, 0)], [(99, 3)], [(5, 5), (90, 80)], [(50, c) for c in range(100)]])
def test_a_few_pixels_do_not_break_it(pixels):
    depth, valid = torch.full((1, 100, 100), torch.nan), torch.zeros(1, 100, 100, dtype=torch.bool)
    for row, column in pixels:
        depth[0, row, column], valid[0, row, column] = 0.02, True
    position, rotation = torch.zeros(1, 3), torch.eye(3)[None]
    points = torch.tensor([[0.02, PIXEL_CENTRES[c], PIXEL_CENTRES[r]] for r, c in pixels], dtype=torch.float32)
    direct = fit_direct(depth, valid, position, rotation).double()
    assert torch.cdist(direct[0], points.double()).min(dim=1).values.max() < 1e-6
    assert torch.cdist(points.double(), direct[0]).min(dim=1).values.max() < 1e-3


def test_charts_of_a_batch_do_not_depend_on_each_other():
    depth, valid = surfaces()
    position, rotation = poses(4)
    together = fit_direct(depth, valid, position, rotation)
    for i in range(4):
        alone = fit_direct(depth[i : i + 1], valid[i : i + 1], position[i : i + 1], rotation[i : i + 1])
        torch.testing.assert_close(alone[0], together[i])


def test_bad_input():
    depth, valid = surfaces()
    position, rotation = poses(4)
    nothing = valid.clone()
    nothing[2] = False
    with pytest.raises(ValueError, match="without valid pixels"):
        fit_direct(depth, nothing, position, rotation)
    depth[0, 4, 4] = torch.nan
    with pytest.raises(ValueError, match="NaN or infinity"):
        fit_direct(depth, valid, position, rotation)


def on_box(n, size, seed):
    """(n, 3) points on the surface of a box, uniform by area."""
    random = np.random.default_rng(seed)
    size = np.asarray(size)
    area = np.repeat(size.prod() / size, 2)
    side = random.choice(6, n, p=area / area.sum())
    points = random.uniform(-0.5, 0.5, (n, 3)) * size
    points[np.arange(n), side // 2] = (side % 2 - 0.5) * size[side // 2]
    return torch.from_numpy(points + [0.1, -0.2, 0.6])


def on_ball(n, radius, seed):
    directions = np.random.default_rng(seed).normal(size=(n, 3))
    return torch.from_numpy(radius * directions / np.linalg.norm(directions, axis=1, keepdims=True))


@pytest.mark.parametrize("surface, scale", [(on_ball, 0.2), (on_box, (0.1, 0.2, 0.4)), (on_box, (0.02, 0.05, 0.45))])
def test_the_atlas_on_a_known_surface(surface, scale):
    points = surface(10_000, scale, 0)
    fitted = fit_atlas(points)
    assert fitted.shape == sphere()[0].shape and fitted.dtype == points.dtype
    assert torch.equal(fitted, fit_atlas(points))
    # In the tables' unit little more than the error of two clouds on the same surface.
    cloud = sample_faces(fitted[None], sphere()[1], 10_000, torch.Generator().manual_seed(0))[0]
    found, least = (chamfer_distance([each], [points])[0] for each in (cloud, surface(10_000, scale, 1)))
    assert (found - least) * CHAMFER_SCALE < 0.05


def test_the_atlas_moves_and_grows_with_the_surface():
    points = on_box(5_000, (0.1, 0.2, 0.3), 0)
    fitted, other = fit_atlas(points, steps=20), fit_atlas(points + 1.0, steps=20)
    torch.testing.assert_close(other - 1.0, fitted, rtol=0, atol=1e-6)
    start = fit_atlas(points, steps=0)  # in the object's box
    assert (start >= points.amin(dim=0)).all() and (start <= points.amax(dim=0)).all()


def test_the_atlas_of_no_point():
    with pytest.raises(ValueError, match="empty"):
        fit_atlas(torch.empty(0, 3))
