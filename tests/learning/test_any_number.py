"""One model for any number of grasps: what it is trained on, and several experiments with the weights of one."""

from collections import Counter
from dataclasses import replace

import igl
import numpy as np
import pytest
import torch

from palpate.charts import vision_atlas
from palpate.experiments import Correction, Experiment
from palpate.learning.checkpoints import load
from palpate.learning.learners import ReconstructionLearner
from palpate.learning.loop import train
from palpate.learning.samples import Assembler, Sample, training_samples, windows
from palpate.models.kriging import touched_points
from palpate.models.retrieval import Objects
from palpate.models.templates import LEAST_FITS
from palpate.strategies import STRATEGIES
from tests.learning.conftest import SETTINGS, made_up
from tests.learning.test_loop import CPU

VISION = len(vision_atlas().vertices)


def row(strategy="template", vision="unoccluded", touch=True, grasps=1, **more):
    return Experiment("experiment", strategy, vision, touch, grasps, **more)


@pytest.fixture(scope="module", params=["charts", "template"])
def trained(request, tmp_path_factory):
    """A strategy, its checkpoint of a model for up to 3 grasps, and the data."""
    folder, data = tmp_path_factory.mktemp(request.param), made_up("unoccluded", "charts", grasps=3)
    experiment = row(request.param, grasps=3, fewer_grasps=True)
    learner = ReconstructionLearner(data, experiment, replace(SETTINGS, steps=12), 0)
    train(learner, folder / "model", folder / "checkpoints", CPU, "test")
    return request.param, folder / "model/best.ckpt", data


def predicted(path, experiment, data, samples):
    with torch.no_grad():
        return load(path, experiment)(Assembler(data, experiment)(samples))


def test_zero_grasps_equal_vision_alone(trained):
    strategy, path, data = trained
    experiment = row(strategy, grasps=3, fewer_grasps=True, weights="other")
    none = predicted(path, experiment, data, [Sample(0, (0, 1), touched=0)])
    assert none.shape[1] == VISION
    touched = predicted(path, experiment, data, [Sample(0, (0, 1))])
    assert (touched[:, :VISION] != none).any()
    if strategy != "charts":  # the graph's weights have an input for the mask, which vision alone has not
        alone = predicted(path, row(strategy, touch=False, weights="other"), data, [Sample(0)])
        assert torch.equal(alone, none)


def test_fewer_grasps_are_those_of_a_model_of_their_number(trained):
    strategy, path, data = trained
    samples = windows(data, row(strategy, grasps=2), "validation")[:2]
    assert all(len(sample.grasps) == 2 for sample in samples)
    of_three = predicted(path, row(strategy, grasps=3, fewer_grasps=True, weights="other"), data, samples)
    of_two = predicted(path, row(strategy, grasps=2, weights="other"), data, samples)
    assert torch.equal(of_three, of_two) and of_two.shape[1] == VISION + 8 * 81


def test_in_training_no_object_is_its_own_template(monkeypatch):
    data = made_up("occluded", "charts")
    learner = ReconstructionLearner(data, row("template", "occluded", fewer_grasps=True), SETTINGS, 0)
    learner.begin()
    train, validation = data.of_split("train"), data.of_split("validation")
    assert torch.equal(learner.model.templates.shapes, torch.from_numpy(data["template"][train]))
    searched, search = [], Objects.best
    monkeypatch.setattr(Objects, "best", lambda *given: searched.append(given[1]) or search(*given))
    for chosen in (train[::-1], validation):
        learner.losses([Sample(number, (0,)) for number in chosen], torch.Generator())
    assert searched[0]["excluded"].tolist() == [train.index(number) for number in train[::-1]]
    assert searched[1]["excluded"].tolist() == [-1] * len(validation)


@pytest.mark.parametrize("vision", ["occluded", "unoccluded", "none"])
def test_a_start_is_made_once_of_the_same_inputs_and_is_the_same(monkeypatch, vision):
    """Samples whose images and touches are others have others; losses are those of a learner that has seen nothing."""
    data = made_up(vision, "charts", grasps=3)
    experiment = row("template", vision, grasps=3, fewer_grasps=True)
    learners = [ReconstructionLearner(data, experiment, SETTINGS, 0) for _ in range(2)]
    kept, fresh = learners
    searched, search = [], Objects.best
    monkeypatch.setattr(Objects, "best", lambda *given: searched.append(given[1]) or search(*given))
    samples = [
        Sample(number, grasps, touched=touched)
        for number in (data.of_split("train")[0], data.of_split("validation")[0])
        for grasps in ((0, 1, 2), (0, 2, 1), (1, 0, 2))
        for touched in range(experiment.fewest_grasps, 3)
    ]
    kept.begin()
    for sample in samples * 2:
        fresh.begin()
        losses = [learner.losses([sample], torch.Generator().manual_seed(0)) for learner in (kept, fresh)]
        assert torch.equal(*losses)
    # Of two objects: without touches of 2 first grasps whose images differ, or 1; of one, 2; of two in order, 3.
    starts = 2 * ({"occluded": 2, "unoccluded": 1, "none": 0}[vision] + 2 + 3)
    assert len(searched) == starts + 2 * len(samples)
    with torch.inference_mode():  # as a validation
        kept.losses([samples[-1]], torch.Generator(), validation=True)
    assert len(searched) == starts + 2 * len(samples) + (vision == "none")  # the fit of the best template


@pytest.mark.parametrize("vision", ["unoccluded", "none"])
def test_a_validation_chooses_how_well_a_template_has_to_fit(monkeypatch, vision):
    """The losses of every choice against the meshes that the model predicts with it, and the choice of the least."""
    data = made_up(vision, "charts", grasps=2)
    experiment = row("template", vision, grasps=2, fewer_grasps=True, correction=Correction(0.08, 0.3))
    learner = ReconstructionLearner(data, experiment, replace(SETTINGS, batch=2), 0)
    learner.begin()
    model, fits = learner.model.eval(), torch.tensor([0.42, 0.77], dtype=torch.float64)
    monkeypatch.setattr(model.templates, "fit", lambda batch: fits[: len(next(iter(batch.values())))])
    for network, scale in ((model.gcn, 0.0), (model.sphere_gcn, 1e-2)):
        torch.nn.init.normal_(network.layers[-1].weight, std=scale)
    with torch.no_grad():
        losses = learner.validation_losses()
        touched = [part[0].touched > 0 for part in learner.validation_batches for _ in part]
        assert sorted(set(touched)) == ([True] if vision == "none" else [False, True])
        monkeypatch.setattr(model, "alternatives", lambda batch: [model(batch)])
        learner.choices = ()
        for column, least in enumerate(LEAST_FITS):
            model.templates.least_fit.fill_(least)
            for row_, is_touched, loss in zip(losses, touched, learner.validation_losses(), strict=True):
                torch.testing.assert_close(row_[int(is_touched), column], loss)
                assert not row_[int(not is_touched)].any()
    assert len(losses.sum(dim=1).unique(dim=1).T) == 3  # both fit well enough, one, none
    learner.choices = losses.shape[1:]
    for without, with_touch in ((3, 12), (12, 21), (21, 0)):
        given = torch.ones(2, len(LEAST_FITS))
        given[0, without], given[1, with_touch] = 0.5, 0.25
        assert learner.choose(given) == 0.75
        assert model.templates.least_fit.tolist() == LEAST_FITS[[without, with_touch]].tolist()
        for group, chosen in ((0, with_touch), (1, without)):  # a validation without samples of one of both
            only = given.clone()
            only[group] = 0.0
            assert learner.choose(only) == given.min(dim=1).values[1 - group]
            assert model.templates.least_fit.tolist() == LEAST_FITS[[chosen, chosen]].tolist()


def test_without_copies_the_vision_charts_are_the_same(monkeypatch):
    # As `template`, without touch charts in the mesh: no strategy of ours.
    monkeypatch.setitem(STRATEGIES, "not_copied", replace(STRATEGIES["template"], copies_touch=False))
    data = made_up("unoccluded", "charts")
    learner = ReconstructionLearner(data, row(), SETTINGS, 0)
    batch = Assembler(data, row())([Sample(0, (0,))])
    other = ReconstructionLearner(data, row("not_copied"), SETTINGS, 0)
    other.model.load_state_dict(learner.model.state_dict())
    with torch.no_grad():
        assert torch.equal(learner.model(batch)[:, :VISION], other.model(batch))


def test_experiments_see_the_same_samples_at_the_same_step():
    data = made_up("occluded", "charts", grasps=5)
    of_one = row(vision="occluded")
    for step in range(20):
        none, one, five = (
            training_samples(data, experiment, 2, 7, step)
            for experiment in (replace(of_one, touch=False), of_one, replace(of_one, grasps=5))
        )
        assert none == one
        assert [sample.object for sample in one] == [sample.object for sample in five]
        assert [sample.grasps for sample in one] == [sample.grasps[:1] for sample in five]


@pytest.mark.parametrize(("vision", "numbers"), [("none", (1, 2, 3)), ("occluded", (0, 1, 2, 3))])
def test_any_number_of_grasps_up_to_its_own(vision, numbers):
    data = made_up(vision, "charts", grasps=3)
    experiment = row(vision=vision, grasps=5, fewer_grasps=True)
    steps = [{sample.touched for sample in training_samples(data, experiment, 4, 0, step)} for step in range(160)]
    assert all(len(of_step) == 1 for of_step in steps)
    counts = [steps.count({number}) for number in numbers]
    assert sum(counts) == 160 and min(counts) > 16
    assert 0 not in numbers or 64 < counts[0] < 96  # half of the steps of a model with vision
    # A validation has every sample by each number, or it would compare classes, which follow one another.
    learner = ReconstructionLearner(data, experiment, replace(SETTINGS, validation_samples=None, batch=2), 0)
    batches = learner.validation_batches
    assert all(len({sample.touched for sample in part}) == 1 for part in batches)
    every = windows(data, experiment, "validation")
    expected = Counter(sample._replace(touched=n) for n in {numbers[0], 1, 3} for sample in every)
    assert Counter(sample for part in batches for sample in part) == expected
    assert {len(sample.grasps) for sample in every} == {3}


def test_an_epoch_of_grasps_has_each_class_as_often_and_no_grasp_twice_before_all():
    data = made_up("occluded", "charts", grasps=5)
    data.classes = ["egg" if number < 3 else "nut" for number in range(len(data))]
    train_split = data.of_split("train")
    classes = [data.classes[each] for each in train_split]
    share = -(-len(train_split) * 5 // len(set(classes)))
    epoch = [
        each
        for step in range(share * len(set(classes)))
        for each in training_samples(data, row(vision="occluded"), 1, 7, step, "grasps")
    ]
    assert set(Counter(data.classes[each.object] for each in epoch).values()) == {share}
    counts = Counter((each.object, *each.grasps) for each in epoch)
    for name in set(classes):
        of_class = [counts[number, g] for number in train_split if data.classes[number] == name for g in range(5)]
        assert max(of_class) - min(of_class) <= 1
    five = training_samples(data, row(vision="occluded", grasps=5), 4, 7, 0, "grasps")
    assert all(sorted(each.grasps) == [0, 1, 2, 3, 4] for each in five)
    assert [each.grasps[:1] for each in five] == [
        each.grasps for each in training_samples(data, row(vision="occluded"), 4, 7, 0, "grasps")
    ]


@pytest.mark.parametrize("strategy", ["charts", "template"])
@pytest.mark.parametrize("vision", ["unoccluded", "none"])
def test_the_correction_moves_vision_charts_to_the_touched_points(strategy, vision):
    """Without touch bit-equal to none; with little noise the surface meets every point that kriging knows."""
    data = made_up(vision, "charts", grasps=3)
    experiment = row(strategy, vision, grasps=3, fewer_grasps=True)
    corrected = replace(experiment, correction=Correction(0.08, 1e-6))
    plain, bent = (ReconstructionLearner(data, each, SETTINGS, 0).model for each in (experiment, corrected))
    batch = Assembler(data, experiment)([Sample(0, (0, 1, 2))])
    batch["start"] = plain.start[:, None]  # a sphere: what templates give is at the touched points already
    with torch.no_grad():
        before, after, *trained = plain(batch), bent(batch), *bent.stages(batch)  # these are without
        assert any(torch.equal(stage[:, :VISION], before[:, :VISION]) for stage in trained)
        if vision != "none":
            none = Assembler(data, experiment)([Sample(0, (0,), touched=0)])
            assert torch.equal(plain(none), bent(none))
    assert torch.equal(before[:, VISION:], after[:, VISION:]) and not torch.equal(before, after)
    known = touched_points(batch)[0].double().numpy()
    faces = vision_atlas().faces.numpy()
    distance, *_ = igl.point_mesh_squared_distance(known, after[0, :VISION].double().numpy(), faces)
    reference, *_ = igl.point_mesh_squared_distance(known, before[0, :VISION].double().numpy(), faces)
    assert np.sqrt(distance).mean() < 0.2 * np.sqrt(reference).mean()
