"""Losses against all pairs of points, in double precision."""

import pytest
import torch

from palpate.models.losses import Target, Truth, reconstruction_loss, subsample


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
        Target(Truth(clouds), [1, 0], 40, torch.Generator()),
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
        vertices + torch.tensor([0, 0, shift]), faces, Target(truth, [0], 2000, torch.Generator().manual_seed(1))
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
