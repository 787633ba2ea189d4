"""Kriging against a dense solve and closed forms, and predictions corrected at touched points."""

import numpy as np
import pytest
import torch
from scipy.spatial.distance import cdist

from palpate.charts import sphere
from palpate.charts.atlas import resized
from palpate.experiments import Correction
from palpate.models.kriging import LEAST_NOISE, Kriging, displaced, touched_points
from tests.models.batches import random_batch

LENGTH, NOISE = 0.08, 0.3
CORRECTION, EXACT = (Correction(LENGTH, noise) for noise in (NOISE, 0.0))


def known(points, values=3, seed=0):
    """Points in a box of 20 cm, values there, and places in it."""
    random = torch.Generator().manual_seed(seed)
    return (
        0.2 * torch.rand(points, 3, generator=random, dtype=torch.float64),
        0.01 * torch.randn(points, values, generator=random, dtype=torch.float64),
        0.2 * torch.rand(50, 3, generator=random, dtype=torch.float64),
    )


def ball():
    vertices, faces = sphere()
    return resized(vertices, 0.1).double(), faces


@pytest.mark.parametrize("points, values", [(1, 3), (9, 1), (180, 3)])
@pytest.mark.parametrize("noise", [0.01, 0.3])
def test_kriging_is_a_dense_solve(points, values, noise):
    places, residuals, queries = known(points, values)
    at_points, at_queries = (np.exp(-cdist(each, places) / LENGTH) for each in (places, queries))
    inverse = np.linalg.inv(at_points + noise * np.eye(points))
    kriging = Kriging(places, residuals, Correction(LENGTH, noise))
    np.testing.assert_allclose(kriging(queries), at_queries @ inverse @ residuals.numpy(), rtol=1e-9, atol=1e-14)
    variance = 1 - np.einsum("mi,ij,mj->m", at_queries, inverse, at_queries)
    np.testing.assert_allclose(kriging.variance(queries), variance, rtol=1e-9)


def test_one_point_in_closed_form():
    place, value, queries = known(1)
    decay = torch.exp(-torch.linalg.vector_norm(queries - place, dim=1) / LENGTH)
    kriging = Kriging(place, value, CORRECTION)
    torch.testing.assert_close(kriging(queries), decay[:, None] * value / (1 + NOISE))
    torch.testing.assert_close(kriging.variance(queries), 1 - decay**2 / (1 + NOISE))


def test_values_are_met_within_their_noise():
    places, values, _ = known(60)
    exact = Kriging(places, values, EXACT)
    torch.testing.assert_close(exact(places), values, rtol=0, atol=1e-6)
    assert exact.variance(places).max() < 2 * LEAST_NOISE
    # The posterior mean differs from a value by its noise times its weight.
    noisy = Kriging(places, values, CORRECTION)
    torch.testing.assert_close(noisy(places), values - NOISE * noisy.weights)


@pytest.mark.parametrize("apart", [0.0, 1e-12, 1e-10])
@pytest.mark.parametrize("noise", [0.0, NOISE])
def test_points_that_coincide(apart, noise):
    # Twice the same point is one point whose value is the mean, with half the noise.
    places, values, queries = known(9)
    others = values + 0.001
    twice = Kriging(torch.cat([places, places + apart]), torch.cat([values, others]), Correction(LENGTH, noise))
    once = Kriging(places, (values + others) / 2, Correction(LENGTH, max(noise, LEAST_NOISE) / 2))
    torch.testing.assert_close(twice(queries), once(queries), rtol=1e-3, atol=1e-6)


def test_nothing_known():
    _, _, queries = known(1)
    empty = Kriging(queries[:0], queries[:0], CORRECTION)
    assert torch.equal(empty(queries), torch.zeros_like(queries))
    assert torch.equal(empty.variance(queries), torch.ones(50, dtype=torch.float64))


def test_blocks_are_the_whole(monkeypatch):
    places, values, queries = known(9)
    kriging = Kriging(places, values, CORRECTION)
    whole = kriging(queries), kriging.variance(queries)
    monkeypatch.setattr("palpate.models.kriging.BLOCK", 7)
    torch.testing.assert_close((kriging(queries), kriging.variance(queries)), whole)


def test_gradients_by_finite_differences():
    inputs = [each.requires_grad_() for each in known(5)]

    def posterior(places, values, queries):
        kriging = Kriging(places, values, CORRECTION)
        return kriging(queries), kriging.variance(queries)

    assert torch.autograd.gradcheck(posterior, inputs)


def test_touched_points_are_nine_of_each_successful_chart():
    batch = random_batch(2, 5)
    batch["charts"][~batch["success"]] = torch.nan
    rows = [9 * row + column for row in (0, 4, 8) for column in (0, 4, 8)]
    for points, charts, success in zip(touched_points(batch), batch["charts"], batch["success"], strict=True):
        chosen = [chart[row] for chart, touched in zip(charts, success, strict=True) for row in rows if touched]
        assert torch.equal(points, torch.stack(chosen))


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_without_touch_nothing_moves(dtype):
    vertices, faces = ball()
    vertices = vertices.to(dtype)
    for surface in (faces, None):
        assert torch.equal(displaced(vertices, surface, vertices[:0], CORRECTION), vertices)
    vertices[3] = torch.nan
    assert displaced(vertices, faces, vertices[:2], CORRECTION) is vertices


@pytest.mark.parametrize("cloud", [True, False])
def test_one_touch_in_closed_form(cloud):
    vertices, faces = ball()
    corners = vertices[faces[7]]
    centre, normal = corners.mean(dim=0), torch.linalg.cross(corners[1] - corners[0], corners[2] - corners[0])
    touched = centre + 0.01 * normal / normal.norm()
    met = vertices[torch.linalg.vector_norm(vertices - touched, dim=1).argmin()] if cloud else centre
    decay = torch.exp(-torch.linalg.vector_norm(vertices - met, dim=1, keepdim=True) / LENGTH)
    moved = displaced(vertices, None if cloud else faces, touched[None], CORRECTION)
    torch.testing.assert_close(moved, vertices + decay * (touched - met) / (1 + NOISE))


def test_in_mixed_precision_a_mesh_is_corrected_alike():
    vertices, faces = ball()
    vertices, touched = vertices.float(), 1.1 * (vertices[:5].float() - vertices[0].float()) + vertices[0].float()
    with torch.autocast("cpu", dtype=torch.bfloat16):
        mixed = displaced(vertices, faces, touched, CORRECTION)
    assert torch.equal(mixed, displaced(vertices, faces, touched, CORRECTION))


def test_a_cloud_meets_what_was_touched():
    vertices, _ = ball()
    touched = 1.1 * vertices[::200] - 0.1 * vertices.mean(dim=0)
    moved = displaced(vertices.float(), None, touched, EXACT)
    assert moved.dtype == torch.float32
    torch.testing.assert_close(moved[::200], touched.float(), rtol=0, atol=1e-6)


def test_gradient_of_a_corrected_cloud():
    random = torch.Generator().manual_seed(0)
    vertices = torch.rand(30, 3, generator=random, dtype=torch.float64).requires_grad_()
    touched = torch.rand(4, 3, generator=random, dtype=torch.float64).requires_grad_()
    assert torch.autograd.gradcheck(
        lambda *inputs: displaced(inputs[0], None, inputs[1], Correction(0.4, NOISE)), (vertices, touched)
    )


def test_gradient_of_a_corrected_mesh_is_finite():
    vertices, faces = ball()
    vertices = vertices.clone().requires_grad_()
    # On a vertex, on the surface, and nearest to a face without area.
    flat = torch.cat([faces, torch.tensor([[0, 0, 0]])])
    touched = torch.stack([vertices[5], vertices[faces[7]].mean(dim=0), 1.2 * vertices[0]]).detach()
    moved = displaced(vertices, flat, touched, CORRECTION)
    moved.square().sum().backward()
    assert torch.isfinite(moved).all() and torch.isfinite(vertices.grad).all()
