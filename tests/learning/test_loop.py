"""Training as a whole, on a few ellipsoids: it resumes to the same bytes, and keeps the last model or the best."""

import csv
import json
import logging
import math
from dataclasses import replace

import pytest
import torch

from palpate.experiments import Experiment
from palpate.learning.checkpoints import load
from palpate.learning.data import ExperimentDataError
from palpate.learning.learners import Diverged, ReconstructionLearner
from palpate.learning.loop import train
from palpate.learning.machine import Machine
from palpate.learning.samples import windows
from tests.learning.conftest import ARCHITECTURE, OCCLUDED_TOUCH, SETTINGS, TOUCH_ONLY, kill_when, made_up

CPU = Machine("cpu")


def run(folder, seed=0, experiment=OCCLUDED_TOUCH, **settings):
    """Train on made-up data; returns what it says and the model that was kept."""
    learner = ReconstructionLearner(made_up(), experiment, replace(SETTINGS, **settings), seed)
    said = train(learner, folder / "model", folder / "checkpoints", CPU, "test")
    return said, load(folder / "model/best.ckpt", experiment)


def history(folder):
    with open(folder / "model/history.csv", newline="") as file:
        return [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]


def weights(folder):
    return torch.load(folder / "model/best.ckpt", weights_only=True)["weights"]


def same(a, b):
    return a.keys() == b.keys() and all(torch.equal(a[key], b[key]) for key in a)


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    folder = tmp_path_factory.mktemp("trained")
    return folder, *run(folder)


def test_outputs(trained):
    folder, said, model = trained
    rows = history(folder)
    assert [row["step"] for row in rows] == [2, 4, 6, 8]
    assert list(rows[0]) == ["step", "seconds", "train_loss", "validation_loss", "rate"]
    assert all(0 < a["seconds"] <= b["seconds"] for a, b in zip(rows, rows[1:], strict=False))
    assert (said["best_step"], said["validation_loss"]) == (8, rows[-1]["validation_loss"])
    assert json.loads((folder / "model/training.json").read_text()) == said
    assert not model.training and not (folder / "checkpoints").exists()
    assert said["validated"] == 2 * 3  # objects of the split, windows of each


def test_it_learns(trained):
    rows = history(trained[0])
    assert rows[-1]["validation_loss"] < 0.95 * rows[0]["validation_loss"]


def test_the_same_seed_gives_the_same_weights_and_another_others(trained, tmp_path):
    run(tmp_path)
    assert same(weights(tmp_path), weights(trained[0]))
    run(tmp_path, seed=1)
    assert not same(weights(tmp_path), weights(trained[0]))


def test_a_killed_training_goes_on_to_the_same_weights(tmp_path):
    """Killed after its first evaluation."""
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    settings = {"evaluate_every": 3, "steps": 31}
    last = killed / "checkpoints/last.ckpt"
    kill_when(last, run, killed, **settings)
    assert not (killed / "model").exists()
    assert 0 < torch.load(last, weights_only=True)["history"][-1]["step"] < 31
    said, _ = run(killed, **settings)
    expected, _ = run(whole, **settings)
    assert same(weights(killed), weights(whole))
    assert said["validation_loss"] == expected["validation_loss"]
    kept = ("step", "train_loss", "validation_loss", "rate")
    assert [[row[key] for key in kept] for row in history(killed)] == [
        [row[key] for key in kept] for row in history(whole)
    ]


class Stop(Exception):
    pass


def interrupted(folder, monkeypatch, at, **settings):
    """Train until a step, where it breaks off."""
    batch = ReconstructionLearner.training_batch

    def stop(self, step):
        if step == at:
            raise Stop
        return batch(self, step)

    monkeypatch.setattr(ReconstructionLearner, "training_batch", stop)
    with pytest.raises(Stop):
        run(folder, **settings)
    monkeypatch.undo()


def test_work_in_progress_of_another_config_is_not_taken(trained, tmp_path, monkeypatch):
    interrupted(tmp_path, monkeypatch, 5, rate=1e-4)
    assert (tmp_path / "checkpoints/last.ckpt").exists()
    run(tmp_path)
    assert same(weights(tmp_path), weights(trained[0]))


@pytest.mark.parametrize("name", ["last.ckpt", "identity"])
def test_damaged_work_in_progress_is_an_error_and_stays(tmp_path, monkeypatch, name):
    interrupted(tmp_path, monkeypatch, 5)
    path = tmp_path / "checkpoints" / name
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(ValueError, match=f"{path} .*remove"):
        run(tmp_path)
    assert path.exists()
    path.write_bytes(content)
    run(tmp_path)


def test_interrupted_before_its_first_evaluation_it_begins_anew(trained, tmp_path, monkeypatch):
    interrupted(tmp_path, monkeypatch, 1)
    run(tmp_path)
    assert same(weights(tmp_path), weights(trained[0]))


def test_finished_but_not_written_out_it_is_not_trained_further(trained, tmp_path, monkeypatch):
    from palpate.learning import loop

    def stop(*_):
        raise Stop

    monkeypatch.setattr(loop, "_write", stop)
    with pytest.raises(Stop):
        run(tmp_path)
    monkeypatch.undo()
    monkeypatch.setattr(ReconstructionLearner, "training_batch", stop)
    run(tmp_path)
    assert same(weights(tmp_path), weights(trained[0]))


def losses_of(monkeypatch, values):
    """Validations find these losses, one after the other."""
    left = iter(values)
    monkeypatch.setattr(ReconstructionLearner, "validation_losses", lambda self: torch.tensor([next(left)]))


def test_patience(tmp_path, monkeypatch):
    losses_of(monkeypatch, [5.0, 4.0, 4.5, 4.0, 3.0, 3.5, 9.0, 1.0])
    said, _ = run(tmp_path, steps=16, patience=2, schedule="constant")
    assert [row["validation_loss"] for row in history(tmp_path)] == [5.0, 4.0, 4.5, 4.0]
    assert (said["best_step"], said["validation_loss"], said["steps"]) == (4, 4.0, 8)


def test_patience_goes_on_counting_after_an_interruption(tmp_path, monkeypatch):
    losses_of(monkeypatch, [5.0, 4.0, 4.5])
    settings = {"steps": 16, "patience": 2, "schedule": "constant"}
    interrupted(tmp_path, monkeypatch, 6, **settings)
    losses_of(monkeypatch, [4.0, 1.0])
    said, _ = run(tmp_path, **settings)
    assert [row["validation_loss"] for row in history(tmp_path)] == [5.0, 4.0, 4.5, 4.0]
    assert (said["best_step"], said["steps"]) == (4, 8)


def test_by_a_rate_that_falls_the_last_is_kept(trained, tmp_path, monkeypatch):
    losses_of(monkeypatch, [5.0, 4.0, 4.5, 6.0])
    said, _ = run(tmp_path)
    held = torch.load(tmp_path / "model/best.ckpt", weights_only=True)
    assert (held["step"], held["validation_loss"], said["best_step"]) == (8, 6.0, 8)
    assert same(weights(tmp_path), weights(trained[0]))


def test_by_a_constant_rate_the_best_is_kept(tmp_path, monkeypatch):
    losses_of(monkeypatch, [5.0, 4.0, 4.5, 6.0])
    said, _ = run(tmp_path, schedule="constant")
    held = torch.load(tmp_path / "model/best.ckpt", weights_only=True)
    assert (held["step"], held["validation_loss"], said["steps"]) == (4, 4.0, 8)
    monkeypatch.undo()
    shorter = tmp_path / "shorter"
    run(shorter, steps=4, schedule="constant")
    longer = tmp_path / "longer"
    losses_of(monkeypatch, [5.0, 4.0, 4.5, 6.0])
    run(longer, schedule="constant")
    assert same(weights(longer), weights(shorter))


def test_numbers_below_the_normal_ones_are_0_while_it_trains(tmp_path, monkeypatch):
    losses, seen = ReconstructionLearner.losses, []

    def half(_=None):
        seen.append(float(torch.tensor(1.5e-38) / 2))

    def looked_at(self, *arguments, **options):
        half()
        found = losses(self, *arguments, **options)
        if found.requires_grad:
            found.register_hook(half)
        return found

    monkeypatch.setattr(ReconstructionLearner, "losses", looked_at)
    half()
    run(tmp_path)
    half()
    assert len(seen) > 8 and not any(seen[1:-1]) and seen[0] == seen[-1] == pytest.approx(7.5e-39)


@pytest.mark.parametrize("precision", ["bf16-true", "16-mixed"])
def test_weights_below_float32_are_refused(tmp_path, precision):
    learner = ReconstructionLearner(made_up(), TOUCH_ONLY, SETTINGS, 0)
    with pytest.raises(ValueError, match="choose one of 32-true"):
        train(learner, tmp_path / "model", tmp_path / "checkpoints", Machine("cpu", precision=precision), "t")


def test_a_prediction_that_is_not_finite_names_its_sample(monkeypatch):
    learner = ReconstructionLearner(made_up(), OCCLUDED_TOUCH, SETTINGS, 0)
    samples = windows(learner.data, OCCLUDED_TOUCH, "train")[2:5]
    values = torch.zeros(3, 7, 3)
    values[1, 4, 2] = torch.nan
    learner.check_finite("the prediction", values[:1], samples[:1])
    with pytest.raises(Diverged, match=r"the prediction is NaN or infinite: step 9, egg-1 grasps \[0\] view 0"):
        learner.check_finite("the prediction", values, samples, "step 9")


def test_a_dead_network_is_an_error(tmp_path):
    """A last hidden layer that is 0 for every input: its gradient is 0, and the last bias alone still moves."""
    learner = ReconstructionLearner(made_up(), OCCLUDED_TOUCH, SETTINGS, 0)
    with torch.no_grad():
        learner.model.gcn.layers[-2].bias.fill_(-1e6)
    moved = sum(weights.numel() for weights in learner.model.parameters()) - 3
    share = f"{moved / (moved + 3):.4%}"
    for _ in range(2):  # it does not go on from there either
        with pytest.raises(Diverged, match=f"by step 2 the network is dead: {share} .* Lower the rate"):
            train(learner, tmp_path / "model", tmp_path / "checkpoints", CPU, "test")
    assert not (tmp_path / "model").exists()


def test_the_rate_follows_one_cycle(tmp_path):
    learner = ReconstructionLearner(made_up(), TOUCH_ONLY, replace(SETTINGS, steps=100, rate=1.0), 0)
    (optimiser, schedule), rates = learner.optimiser(learner.device), []
    for _ in range(100):
        rates += schedule.get_last_lr()
        optimiser.step()
        schedule.step()
    rates += schedule.get_last_lr()
    assert rates[0] == pytest.approx(0.04) and rates[10] == pytest.approx(1) and rates[100] == pytest.approx(1e-4)
    assert rates[5] == pytest.approx(0.52) and rates[55] == pytest.approx(0.50005)
    assert max(rates) == rates[10]


def test_an_epoch_is_every_object_once(tmp_path):
    said, _ = run(tmp_path, steps=None, epochs=3, evaluate_every=None, batch=3)
    assert said["steps"] == 6 and [row["step"] for row in history(tmp_path)] == [2, 4, 6]


def test_an_empty_split_is_said():
    data = made_up()
    data.splits = ["train"] * len(data)
    with pytest.raises(ExperimentDataError, match="no object of the validation split"):
        ReconstructionLearner(data, OCCLUDED_TOUCH, SETTINGS, 0)


def test_progress_is_a_few_lines(tmp_path, caplog, capfd):
    with caplog.at_level(logging.INFO):
        run(tmp_path)
    assert len(caplog.records) <= 2
    assert "step 8 of 8" in caplog.text
    assert capfd.readouterr() == ("", "")


def test_a_gpu_that_is_not_there_is_said(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)  # also where there is one
    with pytest.raises(ValueError, match="config training.device is gpu"):
        Machine("gpu").torch_device()
    assert Machine("auto").torch_device() == torch.device("cpu")


@pytest.mark.parametrize(
    ("strategy", "vision", "touch", "reads"),
    [
        ("sphere", "occluded", True, "readings"),
        ("no_copy", "unoccluded", True, "charts"),
        ("no_comm", "occluded", True, "charts"),
        ("charts", "views", False, "none"),
        ("sphere", "unoccluded", False, "none"),
        ("charts", "none", True, "charts"),
    ],
)
def test_every_kind_of_experiment(tmp_path, strategy, vision, touch, reads):
    experiment = Experiment("any", strategy, vision, touch, 1)
    learner = ReconstructionLearner(made_up(vision, reads), experiment, replace(SETTINGS, steps=2), 0)
    said = train(learner, tmp_path / "model", tmp_path / "checkpoints", CPU, "test")
    assert math.isfinite(said["validation_loss"])
    assert said["architecture"] == ARCHITECTURE.row()
    assert load(tmp_path / "model/best.ckpt", experiment).experiment.row() == experiment.row()


def test_products_in_bfloat16_train_and_leave_weights_in_float32(tmp_path):
    learner = ReconstructionLearner(made_up(), OCCLUDED_TOUCH, SETTINGS, 0)
    train(learner, tmp_path / "model", tmp_path / "checkpoints", Machine("cpu", precision="bf16-mixed"), "test")
    rows, values = history(tmp_path), weights(tmp_path).values()
    assert rows[-1]["validation_loss"] < rows[0]["validation_loss"]
    assert {each.dtype for each in values if each.is_floating_point()} == {torch.float32}
