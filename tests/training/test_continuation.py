"""Going on from a base model: it begins with the base's prediction, and experiments differ in touch only."""

from dataclasses import replace

import pytest
import torch

from palpate.charts import vision_atlas
from palpate.experiments import Experiment
from palpate.inference.checkpoints import CheckpointError, build, continue_from, load
from palpate.inference.samples import Assembler, windows
from palpate.training.learners import ReconstructionLearner
from palpate.training.loop import train
from palpate.training.samples import training_samples
from tests.training.conftest import ARCHITECTURE, SETTINGS, made_up
from tests.training.test_loop import CPU, Stop, same
from tests.training.test_recipes import EXPERIMENTS, resolve

POOLED = {"architecture": replace(ARCHITECTURE, touch="pooled")}
VISION = len(vision_atlas().vertices)


def row(strategy="charts", vision="unoccluded", touch=True, grasps=1):
    return Experiment("experiment", strategy, vision, touch, grasps)


def learner_of(experiment, base=None, seed=0, **settings):
    reads = {"sphere": "readings"}.get(experiment.strategy, "charts") if experiment.touch else "none"
    data = made_up(experiment.vision, reads)
    return ReconstructionLearner(data, experiment, replace(SETTINGS, **POOLED | settings), seed, base)


def trained(folder, experiment, base=None, **settings):
    train(learner_of(experiment, base, **settings), folder / "model", folder / "checkpoints", CPU, "test")
    return folder / "model/best.ckpt"


@pytest.fixture(scope="module")
def bases(tmp_path_factory):
    """A trained model without touch, of charts and of the sphere."""
    return {
        strategy: trained(tmp_path_factory.mktemp(strategy), row(strategy, touch=False), steps=4)
        for strategy in ("charts", "sphere")
    }


@pytest.mark.parametrize(
    ("strategy", "grasps"), [("charts", 1), ("charts", 3), ("no_copy", 1), ("no_comm", 1), ("sphere", 1)]
)
def test_at_the_start_it_predicts_what_its_base_does(bases, strategy, grasps):
    base = bases["sphere" if strategy == "sphere" else "charts"]
    learner = learner_of(row(strategy, grasps=grasps), base)
    batch = Assembler(learner.data, learner.experiment)(windows(learner.data, learner.experiment, "validation")[:2])
    assert batch["success"].any()
    with torch.no_grad():
        vision = load(base)(batch)
        touch = learner.model.eval()(batch)
    assert torch.equal(touch[:, : vision.shape[1]], vision)
    # Charts that are copied come after the base's vertices.
    copied = strategy in ("charts", "no_comm")
    assert touch.shape[1] - vision.shape[1] == (4 * grasps * 81 if copied else 0)


def test_the_first_step_begins_with_the_weights_of_the_base(bases):
    learner = learner_of(row(), bases["charts"], seed=3)
    own, base = learner.model.state_dict(), load(bases["charts"]).state_dict()
    assert all(torch.equal(own[name], values) for name, values in base.items())
    assert not any(values.any() for name, values in own.items() if name in ("touch_pooling.weight",))
    assert not same({name: own[name] for name in base}, build(row(touch=False), POOLED["architecture"]).state_dict())


def test_touch_inputs_learn_from_the_first_step(bases):
    learner = learner_of(row(), bases["charts"])
    learner._rank = lambda: slice(None)
    learner.on_fit_start()
    learner.losses(learner.training_batch(0), torch.Generator().manual_seed(0), learner.model).sum().backward()
    assert learner.model.touch_pooling.weight.grad.abs().max() > 0


def test_the_papers_graph_goes_on_from_the_same_base(bases):
    architecture = replace(ARCHITECTURE, touch="graph")
    learner = learner_of(row(), bases["charts"], architecture=architecture)
    first = learner.model.gcn.layers[0].weight
    assert torch.equal(first[:3], load(bases["charts"]).gcn.layers[0].weight) and not first[3:].any()


def test_a_base_that_does_not_fit(bases, tmp_path):
    with pytest.raises(
        CheckpointError, match="is no base of this model: its start|is no base of this model: its image"
    ):
        continue_from(build(row(vision="none"), POOLED["architecture"]), bases["charts"])
    with pytest.raises(CheckpointError, match="does not exist; train the model with"):
        continue_from(build(row(), POOLED["architecture"]), tmp_path / "models/base/seed-0/best.ckpt")


def test_interrupted_it_goes_on_and_another_base_begins_anew(bases, tmp_path, monkeypatch):
    def run(folder, base):
        learner = learner_of(row(), base, steps=6)
        return train(learner, folder / "model", folder / "checkpoints", CPU, "test")

    def stopped(folder, base):
        step = ReconstructionLearner.training_step

        def stop(self, number, part):
            if number == 4:
                raise Stop
            return step(self, number, part)

        monkeypatch.setattr(ReconstructionLearner, "training_step", stop)
        with pytest.raises(Stop):
            run(folder, base)
        monkeypatch.undo()

    other = trained(tmp_path / "other", row(touch=False), steps=4, rate=1e-3)
    whole = run(tmp_path / "whole", bases["charts"])
    for name, base in (("same", bases["charts"]), ("changed", other)):
        folder = tmp_path / name
        stopped(folder, base)
        assert (folder / "checkpoints/last.ckpt").exists()
        again = run(folder, bases["charts"])
        assert again["identity"] == whole["identity"]
        weights = [load(place / "model/best.ckpt").state_dict() for place in (folder, tmp_path / "whole")]
        assert same(*weights), name


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


def test_any_number_of_grasps_up_to_its_own():
    data = made_up("none", "charts", grasps=3)
    experiment = replace(row(vision="none", grasps=5), fewer_grasps=True)
    numbers = [{len(sample.grasps) for sample in training_samples(data, experiment, 4, 0, step)} for step in range(60)]
    assert all(len(of_step) == 1 for of_step in numbers)
    counts = [numbers.count({k}) for k in (1, 2, 3)]
    assert sum(counts) == 60 and min(counts) > 8
    # Validation takes as many as there are.
    assert {len(sample.grasps) for sample in windows(data, experiment, "validation")} == {3}


def test_settings_of_a_base_and_of_what_goes_on_from_it():
    recipe = resolve({})
    base, touch = EXPERIMENTS["base_occluded"], EXPERIMENTS["charts_occluded_touch"]
    continuation = recipe.reconstruction["continuation"]
    assert recipe.base(touch) == "base_occluded" and recipe.base(base) is None
    of_base, of_touch = recipe.settings(base), recipe.settings(touch)
    assert of_touch == replace(of_base, **continuation) and of_base.rate > of_touch.rate
    scratch = resolve({"reconstruction": {"continuation": None}})
    assert scratch.base(touch) is None and scratch.settings(touch) == of_base
    graph = recipe.settings(EXPERIMENTS["graph_occluded_touch"]).architecture
    assert graph == replace(of_base.architecture, touch="graph")


def test_what_is_compared_goes_on_from_one_model():
    """Rows that differ in touch only have one base, so that nothing else differs."""
    for name, experiment in EXPERIMENTS.items():
        if experiment.base:
            base = EXPERIMENTS[experiment.base]
            assert base.vision == experiment.vision, name
            assert (base.strategy == "sphere") == (experiment.strategy == "sphere"), name
            assert base.base is None and base.touch == (experiment.vision == "none"), name
