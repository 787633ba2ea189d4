"""The study of reconstruction models, on a few ellipsoids with random pictures, trained on four samples."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from palpate.charts import build_tree, sample_faces
from palpate.learning.metrics import score
from studies.error_vs_runtime import reconstruction
from studies.error_vs_runtime.reconstruction import ReconstructionStudy, chamfer
from tests.learning.conftest import ARCHITECTURE, SETTINGS, made_up

# Instance norm: a mean over a batch would differ between batches.
LAYERS = replace(ARCHITECTURE, encoder=replace(ARCHITECTURE.encoder, norm="instance"))
MACHINE = {"precision": "32-true", "threads": 1}


@pytest.fixture
def study(monkeypatch) -> ReconstructionStudy:
    monkeypatch.setattr(reconstruction, "SAMPLES", 4)
    data = made_up("unoccluded", "none")
    return ReconstructionStudy(data, replace(SETTINGS, architecture=LAYERS, batch=1), MACHINE, 500)


def test_the_error_is_the_evaluations(study):
    """Other points of the same surface, so that the two agree to what chance leaves."""
    model, _ = study.trained(study.base)
    (_, case), *others = study.cases()
    assert len(case) == 2 and not others
    for vertices, seen in zip(study.predict(study.base, case), case, strict=True):
        truth = study.data["points"][seen.object]
        predicted = torch.from_numpy(vertices).float()[None]
        points = sample_faces(predicted, model.faces, 4000, torch.Generator().manual_seed(0))
        expected = score(points[0], build_tree(torch.from_numpy(truth))).chamfer
        assert chamfer(vertices, model.faces.numpy(), truth, 4000) == pytest.approx(expected, rel=0.02)


def test_rows_of_training(study):
    (_, case), methods = next(iter(study.cases())), study.methods()
    assert len({str(method) for method in methods}) == len(methods)
    chosen = {method.knob: method.value for method in methods if method.chosen}
    assert chosen == {"width": 9, "layers": 3, "deformations": 3, "precision": "32-true", "batch": 1, "seed": 0}
    found = {str(method): study.errors(case, method.run(case))["Chamfer distance"] for method in methods}
    own = found["training, seed 0"]
    assert own == found["training, width 9"] and np.isfinite(list(found.values())).all()
    changed = ("width 18", "layers 6", "deformations 1", "batch 2", "seed 1")
    assert all(found[f"training, {name}"] != own for name in changed)


def test_what_is_timed_changes_no_prediction(study):
    """Steps go on from the end of a training; predictions are of that end, however often steps were timed."""
    _, case = next(iter(study.cases()))
    before = study.predict(study.base, case)
    going_on = study.trained(study.base)[1].learner.model.gcn.layers[0].weight
    at_first = going_on.detach().clone()
    for _ in range(2):
        assert study._train(study.base, case) == study.base
    assert (going_on != at_first).any()
    np.testing.assert_array_equal(study.predict(study.base, case), before)


def test_a_variant_is_what_it_says_and_is_trained_on_as_many_samples(study):
    variant = study.base._replace(width=12, layers=4, deformations=2, batch=2, seed=1)
    model, step = study.trained(variant)
    shapes = [tuple(layer.weight.shape) for layer in model.gcn.layers]
    assert len(shapes) == 4 and shapes[1] == (12, 12) and model.architecture.deformations == 2
    assert step.learner.settings.steps * step.learner.settings.batch == 4
    assert study.trained(variant)[0] is model
