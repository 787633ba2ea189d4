"""The published single-image networks trained as they were: their losses the long way, and whole trainings."""

import csv
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree

from palpate.architectures import Decoder
from palpate.charts import plane_normals
from palpate.experiments import Experiment
from palpate.learning.checkpoints import build, load
from palpate.learning.learners import Diverged, ReconstructionLearner
from palpate.learning.loop import train
from palpate.learning.machine import Machine
from palpate.learning.samples import windows
from palpate.mesh import OBJECT_POSITION
from palpate.models.losses import Target, Truth
from palpate.models.single_image import laplacian, mean_cosine
from tests.learning.conftest import ARCHITECTURE, SETTINGS, kill_when, made_up
from tests.learning.test_recipes import resolve

STRATEGIES = ("psg", "pixel2mesh", "r2n2")
DECODERS = {"psg": Decoder(12, points=150), "r2n2": Decoder(12, channels=[4, 4, 4, 4], level=0.5)}
CPU = Machine("cpu")
PARTIAL = 60  # of the true points, in the losses


# A rate at which the few steps of so small a network show; of voxels it first learns that most are empty.
LEARNING = {
    strategy: {"steps": steps, "evaluate_every": steps // 4, "rate": 1e-2}
    for strategy, steps in (("psg", 60), ("pixel2mesh", 24), ("r2n2", 120))
}


def experiment(strategy):
    return Experiment(strategy, strategy, "views", False, 1)


def layers(strategy):
    encoder = replace(ARCHITECTURE.encoder, norm="instance")
    return replace(ARCHITECTURE, encoder=encoder, decoder=DECODERS.get(strategy))


def run(folder, strategy, **changed):
    settings = replace(SETTINGS, architecture=layers(strategy), **changed)
    learner = ReconstructionLearner(made_up("views", "none"), experiment(strategy), settings, 0)
    return train(learner, folder / "model", folder / "checkpoints", CPU, "test")


def history(folder):
    with open(folder / "model/history.csv", newline="") as file:
        return [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]


def weights(folder):
    return torch.load(folder / "model/best.ckpt", weights_only=True)["weights"]


@pytest.fixture
def truth():
    """Two ellipsoids of 400 points."""
    points = np.random.default_rng(2).standard_normal((2, 400, 3))
    points /= np.linalg.norm(points, axis=2, keepdims=True)
    return Truth(torch.from_numpy(points * [[[0.1, 0.15, 0.05]], [[0.2, 0.1, 0.1]]] + OBJECT_POSITION))


def nearest_rows(a, b):
    """Which of b is nearest to each of a, and the squared distances, by all pairs."""
    pairs = ((a[:, None] - b[None]) ** 2).sum(axis=2)
    return pairs.argmin(axis=1), pairs.min(axis=1)


def with_gradient(shape, seed=0, spread=0.1):
    random = torch.Generator().manual_seed(seed)
    values = spread * torch.randn(shape, dtype=torch.float64, generator=random) + torch.tensor(OBJECT_POSITION)
    return values.requires_grad_()


def test_points_are_pulled_to_the_surface_and_it_to_them(truth):
    """All true points take part, so that nothing is random."""
    points = with_gradient((2, 30, 3))
    model = build(experiment("psg"), layers("psg"))
    found = model.loss([points], Target(truth, [1, 0], 400, torch.Generator()))
    for k, number in enumerate((1, 0)):
        mine, cloud = points[k].detach().numpy(), truth.points[number].numpy()
        naive = nearest_rows(mine, cloud)[1].mean() + nearest_rows(cloud, mine)[1].mean()
        assert float(found[k].detach()) == pytest.approx(9000 * naive)
    assert torch.autograd.gradcheck(
        lambda each: model.loss([each], Target(truth, [1, 0], 400, torch.Generator())), points, atol=1e-4
    )


def test_pixel2meshs_loss_by_loops(truth):
    """Every term of its section 3.4 written out, vertex by vertex, for three blocks of a real sphere."""
    model = build(experiment("pixel2mesh"), layers("pixel2mesh")).double()
    start = model.start.numpy()
    stages = [with_gradient((1, 1154, 3), seed, 0.05) for seed in range(3)]
    found = model.loss(stages, Target(truth, [1], 400, torch.Generator()))
    neighbours = [set() for _ in start]
    for a, b, c in model.faces.tolist():
        for u, v in ((a, b), (b, c), (c, a)):
            neighbours[u].add(v)
            neighbours[v].add(u)
    cloud, normals = truth.points[1].numpy(), truth.normals(1).numpy()

    def coordinates(vertices):
        return np.array([v - vertices[list(near)].mean(axis=0) for v, near in zip(vertices, neighbours, strict=True)])

    expected, before = 0.0, start
    for stage in stages:
        vertices = stage[0].detach().numpy()
        rows, there = nearest_rows(vertices, cloud)
        chamfer = there.mean() + nearest_rows(cloud, vertices)[1].mean()
        lengths, cosines = [], []
        for u, near in enumerate(neighbours):
            for v in near:
                edge = vertices[u] - vertices[v]
                lengths.append(edge @ edge)
                cosines.append(abs(edge @ normals[rows[u]]) / np.sqrt(edge @ edge))
        change = ((coordinates(vertices) - coordinates(before)) ** 2).sum(axis=1).mean()
        normal = 1.6e-4 / (0.57 / 0.5) ** 2 * np.mean(cosines)
        expected += 9000 * (chamfer + 0.1 * np.mean(lengths) + 0.3 * change + normal)
        before = vertices
    assert float(found.detach()) == pytest.approx(expected / 3)
    found.sum().backward()
    assert all(stage.grad.abs().sum() > 0 for stage in stages)


def test_pixel2meshs_regularisers_in_closed_form():
    """A regular hexagon around its centre: Laplacian coordinates vanish at the centre; edges lie in the plane."""
    angles = torch.arange(6, dtype=torch.float64) * torch.pi / 3
    ring = torch.stack([angles.cos(), angles.sin(), torch.zeros(6)], dim=1)
    vertices = torch.cat([torch.zeros(1, 3), ring]).double()[None]
    edges = torch.tensor([[0, k] for k in range(1, 7)] + [[k, k % 6 + 1] for k in range(1, 7)])
    found = laplacian(vertices, edges)
    assert found[0, 0].abs().max() < 1e-12
    # A vertex of the ring has the centre and two of the ring as neighbours; the mean of these is at a third.
    torch.testing.assert_close(found[0, 1:], ring.double() * 2 / 3)
    along = vertices[:, edges[:, 0]] - vertices[:, edges[:, 1]]
    upright, inclined = torch.zeros(2, 1, 7, 3, dtype=torch.float64)
    upright[..., 2], inclined[..., 0] = 1, 1
    assert float(mean_cosine(along, upright, edges)) == 0
    # Of the twelve edges' directions a third has |cos| 1 with x, the others 1/2.
    assert float(mean_cosine(along, inclined, edges)) == pytest.approx((4 * 1 + 8 * 0.5) / 12)


def test_cross_entropy_of_the_cells(truth):
    odds = 2 * torch.randn(2, 32, 32, 32, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    odds.requires_grad_()
    model = build(experiment("r2n2"), layers("r2n2"))
    found = model.loss([odds], Target(truth, [1, 0], PARTIAL, torch.Generator()))
    for k, number in enumerate((1, 0)):
        there = truth.occupied(number).numpy()
        probability = 1 / (1 + np.exp(-odds[k].detach().numpy()))
        naive = -np.where(there, np.log(probability), np.log(1 - probability)).mean()
        assert float(found[k].detach()) == pytest.approx(naive)
        assert 0.001 < there.mean() < 0.2
    found[0].backward()
    there = truth.occupied(1).double()
    torch.testing.assert_close(odds.grad[0], (odds[0].detach().sigmoid() - there) / 32**3)
    assert not odds.grad[1].any()


def test_what_is_derived_from_the_truth_is_made_once(truth):
    assert truth.normals(1) is truth.normals(1)
    assert truth.occupied(0) is truth.occupied(0)
    points = truth.points[1].double().numpy()
    np.testing.assert_allclose(np.abs(truth.normals(1)), np.abs(plane_normals(points, cKDTree(points))), atol=1e-5)


@pytest.fixture(scope="module", params=STRATEGIES)
def trained(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp(request.param)
    return request.param, folder, run(folder, request.param, **LEARNING[request.param])


def test_it_learns(trained):
    strategy, folder, said = trained
    rows = history(folder)
    assert rows[-1]["train_loss"] < 0.9 * rows[0]["train_loss"]
    assert said["validation_loss"] < rows[0]["validation_loss"]
    assert said["experiment"] == experiment(strategy).row() and said["validated"] == 2 * 5


def test_validation_is_the_chamfer_distance_of_what_is_predicted(trained):
    """For all in the tables' unit, whatever the training's loss: against all pairs, with the model that was kept."""
    strategy, folder, said = trained
    data, model = made_up("views", "none"), load(folder / "model/best.ckpt", experiment(strategy))
    truth, settings = data["points"], replace(SETTINGS, architecture=layers(strategy))
    learner = ReconstructionLearner(data, experiment(strategy), settings, 0)
    learner.model.load_state_dict(model.state_dict())
    learner.eval().begin()
    samples = windows(data, experiment(strategy), "validation")[:2]
    losses = learner.losses(samples, torch.Generator().manual_seed(3), validation=True).tolist()
    generator = torch.Generator().manual_seed(3)
    with torch.inference_mode():
        predictions = model(learner.assemble(samples))
        points = model.sample(predictions, {}, settings.validation_points, generator).numpy()
    for loss, mine, sample in zip(losses, points, samples, strict=True):
        cloud = truth[sample.object]
        chosen = cloud[torch.randperm(len(cloud), generator=generator)[: settings.validation_points].numpy()]
        naive = nearest_rows(mine, cloud)[1].mean() + nearest_rows(chosen, mine)[1].mean()
        assert loss == pytest.approx(9000 * naive, rel=1e-3)


def test_a_killed_training_resumes_to_the_same_bytes(trained, tmp_path):
    strategy, whole, _ = trained
    kill_when(tmp_path / "checkpoints/last.ckpt", run, tmp_path, strategy, **LEARNING[strategy])
    run(tmp_path, strategy, **LEARNING[strategy])
    found, expected = weights(tmp_path), weights(whole)
    assert found.keys() == expected.keys() and all(torch.equal(found[key], expected[key]) for key in found)


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_a_prediction_that_is_not_finite_is_said(strategy, tmp_path):
    settings = replace(SETTINGS, architecture=layers(strategy))
    learner = ReconstructionLearner(made_up("views", "none"), experiment(strategy), settings, 0)
    with torch.no_grad():
        next(learner.model.encoder.parameters()).fill_(float("nan"))
    with pytest.raises(Diverged, match="the prediction is NaN or infinite: egg-"):
        train(learner, tmp_path / "model", tmp_path / "checkpoints", CPU, "test")


def test_the_published_layers_are_those_of_the_papers_recipe():
    found = resolve({}, "paper").settings(experiment("psg")).architecture
    assert found.decoder.points == 256 and found.encoder.channels[-1] == 256
