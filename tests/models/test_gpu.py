"""Trainings, predictions and scores on a GPU: those of the CPU but for rounding. Skipped where torch finds none."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from palpate.experiments import Correction, Experiment
from palpate.learning import checkpoints, evaluate
from palpate.learning.learners import ReconstructionLearner
from palpate.learning.loop import train
from palpate.learning.machine import Machine
from tests.learning.conftest import SETTINGS, made_up
from tests.learning.test_single_image_losses import DECODERS

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="torch finds no GPU")

MODELS = [
    ("charts", "occluded", "charts"),
    ("no_copy", "unoccluded", "charts"),
    ("sphere", "occluded", "readings"),
    ("template", "none", "charts"),
    ("template", "occluded", "charts"),
    ("psg", "views", "none"),
    ("pixel2mesh", "views", "none"),
    ("r2n2", "views", "none"),
]


def learner_of(strategy, vision, touch, **settings):
    """A model of a strategy and its inputs, to be trained on made-up objects."""
    any_number = strategy == "template"
    correction = Correction(0.08, 0.3) if any_number else None
    experiment = Experiment("a", strategy, vision, touch != "none", 2, any_number, correction=correction)
    layers = replace(SETTINGS.architecture, decoder=DECODERS.get(strategy))
    settings = replace(SETTINGS, architecture=layers, **settings)
    return ReconstructionLearner(made_up(vision, touch), experiment, settings, 0)


@pytest.mark.parametrize("model", MODELS)
def test_a_loss_and_its_gradient_are_those_of_the_cpu(model, monkeypatch):
    monkeypatch.setattr(torch.backends.cudnn, "allow_tf32", False)
    learners = [learner_of(*model) for _ in range(2)]
    for learner, device in zip(learners, ("cpu", "cuda"), strict=True):
        learner.to(device).begin()
        learner(0).backward()
    losses = [learner(0).item() for learner in learners]
    assert np.isclose(*losses, rtol=1e-3)
    for (name, one), (_, other) in zip(*(learner.named_parameters() for learner in learners), strict=True):
        if one.grad is not None:
            assert (other.grad.cpu() - one.grad).norm() <= 0.01 * one.grad.norm() + 1e-6, name


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("precision", ["32-true", "bf16-mixed"])
def test_a_model_that_a_gpu_trained_predicts_and_scores_alike_on_both(model, precision, tmp_path):
    learner = learner_of(*model, steps=4)
    machine = Machine("gpu", precision=precision)
    summary = train(learner, tmp_path / "model", tmp_path / "checkpoints", machine, "test")
    assert summary["machine"]["found"] == torch.cuda.get_device_name() and np.isfinite(summary["validation_loss"])
    path = tmp_path / "model/best.ckpt"
    scores = [
        evaluate.evaluate(
            evaluate.Trained(checkpoints.load(path).to(device), learner.experiment, 0, 4, torch.device(device)),
            learner.data,
            500,
        )
        for device in ("cpu", "cuda")
    ]
    assert np.allclose(scores[0].chamfer, scores[1].chamfer, rtol=3e-2)
