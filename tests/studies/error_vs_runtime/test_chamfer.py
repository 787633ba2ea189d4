"""The study of the Chamfer distance: its reference by closed forms, its methods against each other."""

import numpy as np
import pytest
import torch
import trimesh

from palpate.mesh.distance import Surface, sample
from palpate.protocol import CHAMFER_SCALE
from palpate.training.losses import Truth
from studies.error_vs_runtime import chamfer
from studies.error_vs_runtime.chamfer import Chamfer, Pair, changed_loss, exact, training_loss

SIDE, HEIGHT = 0.4, 0.02
CUT = 12  # squares along a side


def square(height: float) -> tuple[np.ndarray, np.ndarray]:
    """A square of CUT x CUT x 2 triangles, around (0, 0, 0.6 + height)."""
    line = np.linspace(-SIDE / 2, SIDE / 2, CUT + 1)
    y, x = np.meshgrid(line, line, indexing="ij")
    vertices = np.stack([x, y, np.full_like(x, 0.6 + height)], axis=2).reshape(-1, 3)
    corner = (np.arange(CUT)[:, None] * (CUT + 1) + np.arange(CUT)).ravel()
    faces = np.stack([corner, corner + 1, corner + CUT + 1, corner + 1, corner + CUT + 2, corner + CUT + 1])
    return vertices, faces.T.reshape(-1, 3)


@pytest.fixture(scope="module")
def pair() -> Pair:
    """Two parallel squares; of the lower one 10,000 random points."""
    surface = Surface(*square(0))
    vertices, faces = square(HEIGHT)
    random = np.random.default_rng(0)
    points = np.column_stack([random.uniform(-SIDE / 2, SIDE / 2, (10_000, 2)), np.full(10_000, 0.6)])
    found = exact(vertices, faces, sample(surface.vertices, surface.faces, 20_000), surface)
    truth = Truth(torch.from_numpy(points).float())
    truth.points = truth.points[None]
    return Pair(torch.from_numpy(vertices).float(), torch.from_numpy(faces), truth, *found)


def test_the_reference_of_parallel_squares(pair):
    assert pair.loss == pytest.approx(CHAMFER_SCALE * 2 * HEIGHT**2, rel=1e-9)
    np.testing.assert_allclose(pair.gradient[:, :2], 0, atol=1e-9)
    # Each way d(h^2)/dh, on every vertex its share of the area.
    assert pair.gradient[:, 2].sum() == pytest.approx(CHAMFER_SCALE * 4 * HEIGHT, rel=1e-9)
    inner = pair.gradient[:, 2].reshape(CUT + 1, CUT + 1)[1:-1, 1:-1]
    np.testing.assert_allclose(inner, CHAMFER_SCALE * 4 * HEIGHT / CUT**2, rtol=0.05)


def test_the_references_gradient_by_moving_and_its_convergence():
    """Of a bent square over a plain one; moved as a whole, for which the density of points does not count."""
    vertices, faces = square(0.01)
    vertices[:, 2] += 0.2 * np.sin(9 * vertices[:, 0]) * vertices[:, 1]
    surface = Surface(*square(0))
    points = sample(surface.vertices, surface.faces, 20_000)
    _, gradient = exact(vertices, faces, points, surface)
    for axis in np.eye(3):
        ahead, behind = (exact(vertices + step * axis, faces, points, surface)[0] for step in (1e-6, -1e-6))
        assert gradient.sum(axis=0) @ axis == pytest.approx((ahead - behind) / 2e-6, rel=1e-4, abs=0.05)
    dense = sample(surface.vertices, surface.faces, 80_000)
    coarse, fine = (exact(vertices, faces, cloud, surface)[0] for cloud in (points, dense))
    assert coarse == pytest.approx(fine, rel=1e-3)


def test_the_loss_is_too_large_by_the_spacing_of_its_points(pair):
    """area / (pi n) on average each way, for points like Poisson's, but for the squares' edges."""
    for n in (300, 2000):
        result = training_loss(n, pair)
        mean = np.mean([result.draw(seed).loss for seed in range(20)])
        expected = CHAMFER_SCALE * SIDE**2 / np.pi * (1 / n + 1 / 10_000)
        assert mean - pair.loss == pytest.approx(expected, rel=0.2)


def test_other_losses_are_the_trainings(pair):
    one = training_loss(400, pair).draw(3)
    for options in ({}, {"search": chamfer._all_pairs}, {"dtype": torch.float64}):
        other = changed_loss(400, pair, **options).draw(3)
        assert other.loss == pytest.approx(one.loss, rel=1e-5)
        np.testing.assert_allclose(other.gradient, one.gradient, rtol=1e-3, atol=1e-3)
    assert changed_loss(400, pair, few_true_points=True).draw(3).loss > one.loss
    off = abs(changed_loss(400, pair, dtype=torch.bfloat16).draw(3).loss / one.loss - 1)
    assert 1e-5 < off < 0.2


def test_an_approximate_search_keeps_its_promise():
    random = np.random.default_rng(0)
    query, points = random.normal(size=(300, 3)), random.normal(size=(3000, 3))
    distance = np.linalg.norm(query[:, None] - points[None], axis=2)
    for error in chamfer.SEARCH_ERRORS:
        found = distance[np.arange(300), chamfer._approximate(error, query, points)]
        assert (found <= (1 + error) * distance.min(axis=1) + 1e-12).all()
    assert (chamfer._all_pairs(query, points) == distance.argmin(axis=1)).all()


def test_what_is_inside_does_not_count():
    outer, inner = trimesh.creation.icosphere(2, 0.2), trimesh.creation.box((0.1, 0.1, 0.1))
    mesh = trimesh.util.concatenate([outer, inner])
    faces = chamfer.outer_faces(mesh)
    assert set(map(tuple, faces)) == set(map(tuple, outer.faces))


def test_bias_and_spread_of_vectors():
    random = np.random.default_rng(0)
    off = np.array([3.0, 4.0]) + random.normal(size=(4000, 2))
    bias, spread = chamfer._bias_and_spread(off)
    assert bias == pytest.approx(5, rel=0.02) and spread == pytest.approx(2**0.5, rel=0.05)
    # Without bias it says less than the mean of so many, which chance makes 0.25 long.
    chance = [chamfer._bias_and_spread(random.normal(size=(16, 1)))[0] for _ in range(400)]
    assert np.mean(np.square(chance)) < 0.05


def test_errors_and_what_is_chosen(pair):
    recipe = {"reconstruction": {"loss_points": 1500}}
    study = Chamfer(settings={"surface": {"points": 10_000}, "recipe": recipe, "evaluation": {"points": 10_000}})
    methods = study.methods()
    assert [(method.name, method.value) for method in methods if method.chosen] == [
        ("loss of training", 1500),
        ("evaluation", 10_000),
    ]
    assert len({str(method) for method in methods}) == len(methods)
    found = {str(m): study.errors(pair, m.run(pair)) for m in methods if m.value in (500, 1500, 3000)}
    few, many = found["loss of training, points 500"], found["loss of training, points 1500"]
    for key in ("loss: root mean square", "loss: bias", "gradient: spread"):
        assert many[key] < few[key]
    assert np.isnan(many["score: bias"]) and np.isnan(found["evaluation, points 3000"]["gradient: bias"])
    expected = 100 * CHAMFER_SCALE * SIDE**2 / np.pi * (1 / 3000 + 1 / 10_000) / pair.loss
    assert found["evaluation, points 3000"]["score: bias"] == pytest.approx(expected, rel=0.25)
