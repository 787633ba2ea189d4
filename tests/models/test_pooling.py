"""Pooling against maps whose value is known everywhere, the numpy camera, and one vertex at a time."""

import math

import numpy as np
import pytest
import torch

from palpate.camera import looking_at, paper_camera
from palpate.mesh import OBJECT_POSITION
from palpate.models.pooling import pool, relative_camera

SIZE = 256


def matrix_of(camera):
    return relative_camera(torch.from_numpy(camera.intrinsics() @ camera.extrinsics()), camera.size)


@pytest.fixture
def positions():
    """(50, 2, 3) in a ball as large as the atlas."""
    random = torch.Generator().manual_seed(0)
    direction = torch.nn.functional.normalize(torch.randn(50, 2, 3, generator=random, dtype=torch.float64), dim=2)
    return 0.26 * torch.rand(50, 2, 1, generator=random) ** (1 / 3) * direction + torch.tensor(OBJECT_POSITION)


def ramp(first, step, count):
    """(2, 2, n, n) maps: of the column, and of the row, at first + i step."""
    line = (first + step * torch.arange(count, dtype=torch.float64)).expand(2, 1, count, count)
    return torch.cat([line, line.transpose(2, 3)], dim=1)


@pytest.mark.parametrize("count", [256, 51, 4])
def test_extent_maps_cover_the_image_edge_to_edge(positions, count):
    cell = SIZE / count
    pooled = pool([ramp(cell / 2, cell, count)], positions, matrix_of(paper_camera()))
    pixels, _ = paper_camera().project(positions.numpy())
    # Beyond the centres of the outer cells there is nothing to interpolate: the edge's value holds.
    expected = np.clip(pixels, cell / 2, SIZE - cell / 2)
    np.testing.assert_allclose(pooled.numpy(), expected, rtol=0, atol=1e-8)


def test_each_vertex_by_hand(positions):
    random = torch.Generator().manual_seed(1)
    maps = [
        torch.randn(2, 3, 7, 7, generator=random, dtype=torch.float64),
        torch.randn(2, 2, 5, 5, dtype=torch.float64),
    ]
    cameras = [paper_camera(), looking_at(OBJECT_POSITION, (0.5, -0.8, 0.9), size=SIZE)]
    matrices = torch.stack([matrix_of(camera) for camera in cameras])
    pooled = pool(maps, positions, matrices)
    for vertex in range(0, 50, 7):
        for sample, camera in enumerate(cameras):
            column, row = camera.project(positions[vertex, sample].numpy())[0]
            expected = []
            for features in maps:
                count = features.shape[-1]
                x, y = (np.clip(v / SIZE * count - 0.5, 0, count - 1) for v in (column, row))
                left, top = min(math.floor(x), count - 2), min(math.floor(y), count - 2)
                cells = features[sample, :, top : top + 2, left : left + 2]
                across = cells[..., 0] * (1 - (x - left)) + cells[..., 1] * (x - left)
                expected.append(across[:, 0] * (1 - (y - top)) + across[:, 1] * (y - top))
            torch.testing.assert_close(pooled[vertex, sample], torch.cat(expected), rtol=1e-9, atol=1e-9)


def test_gradients_by_finite_differences(positions):
    maps = torch.randn(2, 2, 6, 6, dtype=torch.float64, requires_grad=True)
    few = positions[:4].clone().requires_grad_()
    camera = matrix_of(paper_camera())

    def pooled(maps, positions):
        return pool([maps], positions, camera)

    assert torch.autograd.gradcheck(pooled, (maps, few))


def test_places_that_are_not_seen_are_finite():
    camera = paper_camera()
    behind = torch.from_numpy(camera.position + camera.rotation[:, 2]).expand(1, 1, 3)
    at = torch.from_numpy(camera.position).expand(1, 1, 3)
    for place in (behind, at, at * 100):
        place = place.clone().requires_grad_()
        pooled = pool([ramp(0, 1, 9)[:1]], place, matrix_of(camera))
        pooled.sum().backward()
        assert torch.isfinite(pooled).all() and torch.isfinite(place.grad).all()
        assert pooled.min() >= 0 and pooled.max() <= 8
