"""The study of the Chamfer distance: its reference by closed forms, its methods against each other."""

import numpy as np
import pytest
import torch
import trimesh

from palpate.mesh.distance import Surface
from palpate.models.losses import Truth
from palpate.protocol import CHAMFER_SCALE
from studies.error_vs_runtime import chamfer
from studies.error_vs_runtime.chamfer import Chamfer, Pair, exact, training_loss
from studies.surface_distance import sample

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
    return Pair(torch.from_numpy(vertices).float(), torch.from_numpy(faces), truth, found)


def test_the_reference_of_parallel_squares(pair):
    assert pair.distance == pytest.approx(CHAMFER_SCALE * 2 * HEIGHT**2, rel=1e-9)


def test_the_reference_of_a_bent_square_in_closed_form_and_its_convergence(monkeypatch):
    """Over a plain square each of its points is as far as it is high; back, more points change nothing."""
    vertices, faces = square(0.01)
    vertices[:, 2] += 0.2 * np.sin(9 * vertices[:, 0]) * vertices[:, 1]
    surface = Surface(*square(0))
    on = sample(vertices, faces, 400_000)
    found = [exact(vertices, faces, sample(surface.vertices, surface.faces, n), surface) for n in (20_000, 80_000)]
    assert found[0] == pytest.approx(found[1], rel=1e-3)
    assert found[1] > CHAMFER_SCALE * ((on[:, 2] - 0.6) ** 2).mean() > 0.4 * found[1]
    monkeypatch.setattr(chamfer, "REFERENCE_POINTS", 50_000)
    fewer = exact(vertices, faces, sample(surface.vertices, surface.faces, 80_000), surface)
    assert fewer == pytest.approx(found[1], rel=1e-3)


def test_the_loss_is_too_large_by_the_spacing_of_its_points(pair):
    """area / (pi n) on average each way, for points like Poisson's, but for the squares' edges."""
    for n in (300, 2000):
        result = training_loss(n, pair)
        mean = np.mean([result.draw(seed) for seed in range(20)])
        expected = CHAMFER_SCALE * SIDE**2 / np.pi * (1 / n + 1 / 10_000)
        assert mean - pair.distance == pytest.approx(expected, rel=0.2)


def test_what_is_inside_does_not_count():
    outer, inner = trimesh.creation.icosphere(2, 0.2), trimesh.creation.box((0.1, 0.1, 0.1))
    mesh = trimesh.util.concatenate([outer, inner])
    faces = chamfer.outer_faces(mesh)
    assert set(map(tuple, faces)) == set(map(tuple, outer.faces))


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
    for key in ("loss: root mean square", "loss: bias"):
        assert many[key] < few[key]
    assert np.isnan(many["score: bias"]) and np.isnan(found["evaluation, points 3000"]["loss: bias"])
    expected = 100 * CHAMFER_SCALE * SIDE**2 / np.pi * (1 / 3000 + 1 / 10_000) / pair.distance
    assert found["evaluation, points 3000"]["score: bias"] == pytest.approx(expected, rel=0.25)
