"""What implicit models are trained with: their targets, their loss the long way, and a whole training."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from palpate.architectures import Decoder
from palpate.evaluation.evaluate import Trained, evaluate
from palpate.experiments import Experiment
from palpate.inference.checkpoints import build, load
from palpate.inference.inputs import inputs, stages
from palpate.inference.samples import Assembler, Sample
from palpate.mesh import OBJECT_POSITION
from palpate.models import implicit
from palpate.training.implicit import MASK_WEIGHT, Target, Targets, implicit_loss
from palpate.training.learners import ReconstructionLearner
from palpate.training.loop import train
from tests.training.conftest import ARCHITECTURE, SETTINGS, made_up
from tests.training.test_loop import CPU

ENCODER = replace(ARCHITECTURE.encoder, norm="instance", downsample=2)
LAYERS = replace(ARCHITECTURE, encoder=ENCODER, decoder=Decoder(16, layers=2))
ANY = Experiment("any", "implicit", "occluded", True, 2, fewer_grasps=True)


def supervised(vision="occluded"):
    """The made-up objects, taken to be balls, with distances and masks."""
    data, random = made_up(vision), np.random.default_rng(5)
    objects = len(data)
    points = random.uniform(-0.13, 0.13, (objects, 300, 3)).astype(np.float32)
    data.arrays |= {
        "distance_points": points + np.float32(OBJECT_POSITION),
        "distance": np.linalg.norm(points, axis=2) - np.linspace(0.1, 0.15, objects, dtype=np.float32)[:, None],
        "unoccluded_mask": 255 * random.integers(0, 2, (objects, 1, 24, 24), dtype=np.uint8),
    }
    if vision == "occluded":
        data.arrays["occluded_mask"] = 255 * random.integers(0, 2, (objects, 3, 1, 24, 24), dtype=np.uint8)
    return data


def test_what_only_the_training_reads():
    more = {item.name for item in inputs(ANY, training=True)} - {item.name for item in inputs(ANY)}
    assert more == {"distance_points", "distance", "unoccluded_mask", "occluded_mask"}
    assert set(stages(ANY, training=True)) - set(stages(ANY)) == {"distances"}
    unoccluded = replace(ANY, vision="unoccluded")
    assert "occluded_mask" not in {item.name for item in inputs(unoccluded, training=True)}
    others = Experiment("other", "pooled", "occluded", True, 1)
    assert inputs(others, training=True) == inputs(others)


@pytest.mark.parametrize("vision", ["occluded", "unoccluded"])
def test_targets_are_the_objects_own(vision):
    data = supervised(vision)
    targets = Targets(data, replace(ANY, vision=vision), torch.device("cpu"))
    samples = [Sample(3, (2, 0)), Sample(1, (1, 2))]
    target = targets(samples, 40, torch.Generator().manual_seed(0))
    for k, sample in enumerate(samples):
        points, distances = data["distance_points"][sample.object], data["distance"][sample.object]
        places = {tuple(point): distance for point, distance in zip(points, distances, strict=True)}
        found = [places[tuple(point)] for point in target.points[k].numpy().astype(np.float32)]
        np.testing.assert_array_equal(target.distances[k].numpy().astype(np.float32), found)
        whole = data["unoccluded_mask"][sample.object, 0]
        seen = data["occluded_mask"][sample.object, sample.grasps[0], 0] if vision == "occluded" else whole
        for mask, pixels in zip(target.masks[k], (whole, seen), strict=True):
            # 64 cells of 24 pixels: a cell averages the pixels that it meets.
            cell = mask[40, 11].item()
            assert cell == pytest.approx(pixels[15:16, 4:5].mean() / 255) and mask.shape == (64, 64)


def test_the_loss_the_long_way():
    model = build(ANY, LAYERS)
    random = torch.Generator().manual_seed(0)
    distances, true = 0.1 * torch.randn(2, 2, 30, generator=random, dtype=torch.float64)
    odds = torch.randn(2, 2, 64, 64, generator=random, dtype=torch.float64)
    masks = torch.rand(2, 2, 64, 64, generator=random, dtype=torch.float64)
    found = implicit_loss(model, distances, odds, Target(torch.empty(2, 30, 3), true, masks))
    for k in range(2):
        total = 0.0
        for guess, truth in zip(distances[k].tolist(), true[k].tolist(), strict=True):
            low, high = (truth if abs(truth) < 0.05 else -0.05 if truth < 0 else 0.05 for _ in range(2))
            far = abs(truth) >= 0.05 and abs(guess) >= 0.05 and guess * truth > 0
            total += 0 if far else 1000 * abs(guess - low) / 30
            assert low == high
        share = odds[k].sigmoid()
        entropy = -(masks[k] * share.log() + (1 - masks[k]) * (1 - share).log()).mean().item()
        assert found[k].item() == pytest.approx(total + MASK_WEIGHT * entropy)


def test_a_distance_that_is_far_off_on_the_wrong_side_has_a_gradient():
    model, zeros = build(ANY, LAYERS), torch.zeros(1, 2, 64, 64)
    guess = torch.tensor([[0.3, 0.3, -0.3]], requires_grad=True)
    target = Target(torch.empty(1, 3, 3), torch.tensor([[0.2, -0.2, 0.01]]), zeros)
    implicit_loss(model, guess, zeros, target).sum().backward()
    assert guess.grad[0, 0] == 0 and guess.grad[0, 1] > 0 and guess.grad[0, 2] < 0


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    folder = tmp_path_factory.mktemp("implicit")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(implicit, "DOUBLINGS", 1)
        settings = replace(SETTINGS, architecture=LAYERS, rate=1e-2, steps=200, evaluate_every=200)
        train(ReconstructionLearner(supervised(), ANY, settings, 0), folder / "model", folder / "work", CPU, "x")
    return folder / "model/best.ckpt"


def test_a_training_learns_the_distance(trained):
    """Better than one distance everywhere."""
    model, data, sample = load(trained), supervised(), [Sample(0, (0, 1))]
    target = Targets(data, ANY, torch.device("cpu"))(sample, 300, torch.Generator().manual_seed(1))
    with torch.no_grad():
        distances, _ = model.supervised(Assembler(data, ANY)(sample), target.points)
    true = target.distances.clamp(-0.05, 0.05)
    assert (distances.clamp(-0.05, 0.05) - true).abs().mean() < 0.5 * (true - true.median()).abs().mean()


@pytest.mark.parametrize("grasps", [0, 1, 2])
def test_an_evaluation_has_all_columns(trained, grasps, monkeypatch):
    monkeypatch.setattr(implicit, "DOUBLINGS", 1)
    row = Experiment("row", "implicit", "occluded", grasps > 0, max(grasps, 1), weights="any")
    table = evaluate(Trained(load(trained, row), row, 0, 60), supervised(), 500, ("validation",))
    assert len(table) == 6 and np.isfinite(table[["chamfer", "f1_tau", "bend", "folded", "gap", "across"]]).all(
        axis=None
    )
    assert (table["gap"] == 0).all() and (table["bend"] > 0).all()
