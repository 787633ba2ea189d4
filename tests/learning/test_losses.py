"""Losses against all pairs of points, in double precision."""

import numpy as np
import pytest
import torch

from palpate.learning.losses import Truth, reconstruction_loss, subsample, touch_depth_loss
from palpate.learning.touch_charts import depth_to_points, touched
from palpate.touch.sensor import PIXEL_CENTRES


def all_pairs(a, b):
    """9000 times the mean squared distance from each of a to the nearest of b."""
    return 9000 * ((a[:, None] - b[None]) ** 2).sum(axis=2).min(axis=1).mean()


def test_reconstruction_of_a_point_like_mesh():
    """All faces in one tiny triangle: wherever points are sampled, the distances are those of that place."""
    place = torch.tensor([0.1, -0.2, 0.7], dtype=torch.float64)
    vertices = place + 1e-9 * torch.tensor([[0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype=torch.float64)
    clouds = torch.randn(2, 40, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    found = reconstruction_loss(
        vertices[None].repeat(2, 1, 1),
        torch.tensor([[0, 1, 2]]),
        Truth(clouds),
        [1, 0],
        40,
        torch.Generator(),
    )
    for loss, cloud in zip(found, clouds.numpy()[[1, 0]], strict=True):
        here = place.numpy()[None]
        assert float(loss) == pytest.approx(all_pairs(here, cloud) + all_pairs(cloud, here), rel=1e-6)


def test_reconstruction_on_a_truth_of_its_own_points_is_small_and_moves_with_the_mesh():
    corners = torch.tensor([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]], dtype=torch.float64)
    faces = torch.tensor([[0, 1, 2], [1, 3, 2]])
    grid = torch.linspace(0.005, 0.995, 100, dtype=torch.float64)
    plane = torch.stack([*torch.meshgrid(grid, grid, indexing="ij"), torch.zeros(100, 100, dtype=torch.float64)], 2)
    truth = Truth(plane.reshape(1, -1, 3))
    vertices = corners.clone().requires_grad_()
    shift = 0.3
    loss = reconstruction_loss(
        vertices + torch.tensor([0, 0, shift]), faces, truth, [0], 2000, torch.Generator().manual_seed(1)
    ).sum()
    # Both directions see the distance of the planes, and little more.
    assert float(loss.detach()) / 9000 == pytest.approx(2 * shift**2, rel=1e-2)
    loss.backward()
    # d/dz of 2 z^2, shared by the four corners.
    assert float(vertices.grad[0, :, 2].sum()) / 9000 == pytest.approx(4 * shift, rel=1e-6)


def test_the_tree_of_a_cloud_is_built_once():
    truth = Truth(torch.rand(3, 10, 3))
    first = truth.trees([2, 0, 2])
    assert first[0] is first[2] and truth.trees([0])[0] is first[1]


def test_some_are_different_rows():
    rows = torch.arange(30).reshape(10, 3)
    chosen = subsample(rows, 6, torch.Generator().manual_seed(0))
    assert len({tuple(row.tolist()) for row in chosen}) == 6
    assert subsample(rows, None, torch.Generator()) is rows and subsample(rows, 10, torch.Generator()) is rows


def test_touched_is_the_supplements_threshold():
    empty = torch.full((3, 2, 2), 0.5)
    reading = empty.clone()[None]
    reading[0, :, 0, 0] += 0.0184  # 3 x 0.0184^2 = 0.00102
    reading[0, :, 0, 1] += 0.0182  # 0.00099
    reading[0, 1, 1, 0] -= 0.0317  # 0.001005
    assert touched(reading, empty).tolist() == [[[True, False], [True, False]]]


def test_the_sheet_has_columns_along_y_and_rows_along_z():
    depth = torch.rand(100, 100, dtype=torch.float64)
    points = depth_to_points(depth)
    for row, column in [(0, 0), (3, 97), (99, 12)]:
        expected = [float(depth[row, column]), PIXEL_CENTRES[column], PIXEL_CENTRES[row]]
        np.testing.assert_allclose(points[row, column], expected, rtol=1e-12)


def test_touch_depth_against_all_pairs():
    random = np.random.default_rng(0)
    y, z = np.meshgrid(PIXEL_CENTRES, PIXEL_CENTRES)
    depth = 0.02 + 0.1 * y + np.where(np.hypot(y, z) < 0.002, 0, np.inf)
    predicted = 0.02 + 0.002 * random.standard_normal((100, 100))
    valid = np.hypot(y, z - 0.001) < 0.002
    a = np.stack([predicted, y, z], 2)[valid]
    b = np.stack([depth, y, z], 2)[np.isfinite(depth)]
    tensors = [torch.from_numpy(array)[None] for array in (predicted, valid, depth)]
    tensors[0].requires_grad_()
    losses = touch_depth_loss(*tensors, None, torch.Generator())
    losses.sum().backward()
    found = float(losses.detach())
    assert found == pytest.approx(all_pairs(a, b) + all_pairs(b, a), rel=1e-9)
    assert not tensors[0].grad[0][~torch.from_numpy(valid)].any()
    # A step against the gradient lowers it.
    with torch.no_grad():
        lower = touch_depth_loss(tensors[0] - 1e-6 * tensors[0].grad, *tensors[1:], None, torch.Generator())
    assert float(lower) < found
    sampled = [
        float(touch_depth_loss(tensors[0].detach(), *tensors[1:], 100, torch.Generator().manual_seed(k)))
        for k in range(40)
    ]
    assert np.mean(sampled) == pytest.approx(found, rel=0.1)
