"""The study of reconstruction models, on a few ellipsoids with random pictures, trained on four samples."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from palpate.charts import sample_faces
from palpate.evaluation.metrics import score
from studies.error_vs_runtime import reconstruction
from studies.error_vs_runtime.reconstruction import ReconstructionStudy, chamfer
from tests.training.conftest import ARCHITECTURE, SETTINGS, made_up

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
    result = study._predict(study.base, case)
    for vertices, seen in zip(result.vertices, case, strict=True):
        truth = study.data["points"][seen.object]
        points = sample_faces(torch.from_numpy(vertices)[None], model.faces, 4000, torch.Generator().manual_seed(0))
        expected = score(points[0].float(), torch.from_numpy(truth)).chamfer
        assert chamfer(vertices, model.faces.numpy(), truth, 4000) == pytest.approx(expected, rel=0.02)


def test_rows_of_training_and_of_inference(study):
    (_, case), methods = next(iter(study.cases())), study.methods()
    assert len({str(method) for method in methods}) == len(methods)
    chosen = {(method.name, method.knob): method.value for method in methods if method.chosen}
    assert chosen == {
        ("training", "width"): 9,
        ("training", "layers"): 3,
        ("training", "deformations"): 3,
        ("training", "precision"): "32-true",
        ("training", "batch"): 1,
        ("training", "seed"): 0,
        ("inference", "width"): 9,
        ("inference", "layers"): 3,
        ("inference", "deformations"): 3,
        ("inference", "batch"): 8,
        ("inference", "precision"): "float32",
    }
    found = {str(method): study.errors(case, method.run(case)) for method in methods}
    inference, training, rounding = study.units
    for name, errors in found.items():
        of_training = name.startswith("training")
        assert np.isnan(errors[inference]) == of_training == np.isnan(errors[rounding])
        assert np.isnan(errors[training]) != of_training
    at = found["inference, precision float32"]
    assert found["inference, precision float64"][rounding] == 0
    assert 0 < at[rounding] < 1e-3 < found["inference, precision bfloat16"][rounding] < 50
    assert found["inference, batch 1"][rounding] < 1e-3
    for knob, own in (("width", 9), ("layers", 3), ("deformations", 3)):
        errors = found[f"inference, {knob} {own}"]
        assert errors[inference] == pytest.approx(found[f"training, {knob} {own}"][training], rel=1e-4)
        assert found[f"inference, {knob} {2 * own if knob != 'deformations' else 1}"] != errors


def test_what_is_timed_changes_no_prediction(study):
    """Steps go on from the end of a training; predictions are of that end, however often steps were timed."""
    _, case = next(iter(study.cases()))
    before = study._predict(study.base, case).vertices
    going_on = study.trained(study.base)[1].learner.model.gcn.layers[0].weight
    at_first = going_on.detach().clone()
    for _ in range(2):
        result = study._train(study.base, case)
    assert (going_on != at_first).any()
    np.testing.assert_array_equal(study._predict(study.base, case).vertices, before)
    np.testing.assert_allclose(result.vertices, before, atol=1e-6)


def test_a_variant_is_what_it_says_and_is_trained_on_as_many_samples(study):
    variant = study.base._replace(width=12, layers=4, deformations=2, batch=2, seed=1)
    model, step = study.trained(variant)
    shapes = [tuple(layer.weight.shape) for layer in model.gcn.layers]
    assert len(shapes) == 4 and shapes[1] == (12, 12) and model.architecture.deformations == 2
    assert step.learner.settings.steps * step.learner.settings.batch == 4
    assert study.trained(variant)[0] is model
