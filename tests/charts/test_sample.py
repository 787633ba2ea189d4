"""Points on faces against areas, planes and closed forms."""

import pytest
import torch

from palpate.charts import sample_faces, sphere

SQUARES = torch.tensor([[[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [5, 5, 5], [8, 5, 5], [5, 8, 5.0]]])
FACES = torch.tensor([[4, 4, 5], [0, 1, 2], [0, 2, 3], [4, 5, 5], [4, 5, 6], [1, 1, 1]])  # areas 0 .5 .5 0 4.5 0


def seeded(seed=0):
    return torch.Generator().manual_seed(seed)


def test_faces_are_chosen_by_area_and_those_without_never():
    points = sample_faces(SQUARES.repeat(2, 1, 1), FACES, 20000, seeded())
    assert points.shape == (2, 20000, 3)
    on_square, on_triangle = points[..., 2] == 0, (points[..., 2] - 5).abs() < 1e-5
    assert (on_square | on_triangle).all()
    share = on_square.double().mean().item()
    assert share == pytest.approx(1 / 5.5, abs=4 * (0.18 * 0.82 / 40000) ** 0.5)
    assert not torch.equal(points[0], points[1])


def test_of_the_faces_that_are_shown_points_are_as_of_a_mesh_that_has_no_others():
    for shown in ([0, 1, 0, 0, 0, 1], [1, 0, 1, 1, 1, 1], [1] * 6):
        row = torch.tensor([shown], dtype=torch.bool)
        given = sample_faces(SQUARES, FACES, 1000, seeded(), row), sample_faces(SQUARES, FACES[row[0]], 1000, seeded())
        assert torch.equal(*given)


def test_points_are_uniform_on_a_face():
    points = sample_faces(SQUARES, FACES[1:3], 40000, seeded(1))[0]
    counts = torch.histogramdd(points[:, :2], bins=8, range=[0, 1, 0, 1]).hist
    expected = 40000 / 64
    # 63 degrees of freedom: above 120 with probability 2e-5.
    assert ((counts - expected) ** 2 / expected).sum() < 120


def test_points_on_the_sphere():
    vertices, faces = sphere()
    points = sample_faces(vertices[None], faces, 50000, seeded(2))[0] - torch.tensor([0, 0, 0.6])
    radius = points.norm(dim=1)
    assert (radius > 0.25).all() and (radius < 0.2601).all()
    assert points.mean(dim=0).abs().max() < 4 * 0.26 / 3**0.5 / 50000**0.5


def test_same_generator_same_points():
    first, second, other = (sample_faces(SQUARES, FACES, 100, seeded(seed)) for seed in (3, 3, 4))
    assert torch.equal(first, second) and not torch.equal(first, other)


def test_a_draw_at_the_very_end_stays_on_a_face_with_area(monkeypatch):
    draw = torch.rand

    def largest(*shape, **options):
        return torch.full_like(draw(*shape, **options), torch.nextafter(torch.tensor(1.0), torch.tensor(0.0)))

    monkeypatch.setattr(torch, "rand", largest)
    for scale in (1e-6, 0.1, 0.3, 7e5):
        points = sample_faces(SQUARES * scale, FACES, 3)
        torch.testing.assert_close(points[..., 2] / scale, torch.full((1, 3), 5.0))


def test_points_move_with_their_face():
    vertices = SQUARES.double().requires_grad_()
    assert torch.autograd.gradcheck(lambda v: sample_faces(v, FACES[[1, 2, 4]], 20, seeded()), (vertices,))
    # Weights sum to one: all gradients together are the points'.
    sample_faces(vertices, FACES, 20, seeded()).sum().backward()
    torch.testing.assert_close(vertices.grad.sum(dim=1), torch.full((1, 3), 20.0, dtype=torch.float64))


def test_bad_input():
    flat = torch.cat([SQUARES, torch.ones_like(SQUARES)])
    with pytest.raises(ValueError, match="zero area"):
        sample_faces(flat, FACES, 10)
    for value in (torch.nan, torch.inf):
        broken = SQUARES.clone()
        broken[0, 2, 1] = value
        with pytest.raises(ValueError, match="NaN or infinite"):
            sample_faces(broken, FACES, 10)
