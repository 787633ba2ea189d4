"""Strategies: what they accept and take, without torch; and a new one, which is a row and nothing else."""

import subprocess
import sys

import numpy as np
import pytest

from palpate.experiments import METHODS, Experiment
from palpate.learning.evaluate import evaluate, load
from palpate.learning.inputs import stages
from palpate.learning.learners import ReconstructionLearner
from palpate.learning.loop import train
from palpate.learning.machine import Machine
from palpate.strategies import STRATEGIES, Strategy
from tests.learning.conftest import SETTINGS, made_up


def test_what_experiments_take_is_known_without_torch():
    code = (
        "import sys; from palpate.learning.inputs import stages; from palpate.experiments import Experiment;"
        "print(*stages(Experiment('a', 'template', 'occluded', True, 1), training=True));"
        "sys.exit('torch' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0 and done.stdout.split() == ["surface", "vision", "touch", "charts", "templates"]


def test_every_method_is_of_a_strategy_and_every_strategy_has_one():
    assert {method.strategy for method in METHODS.values()} == set(STRATEGIES)


@pytest.mark.parametrize(
    ("name", "vision", "touch", "accepted"),
    [
        ("charts", "none", False, False),
        ("charts", "none", True, True),
        ("charts", "views", False, True),
        ("no_copy", "occluded", False, False),
        ("no_comm", "none", True, False),
        ("no_comm", "occluded", True, True),
        ("template", "views", False, False),
        ("retrieval", "unoccluded", False, True),
        ("psg", "occluded", False, False),
        ("psg", "views", True, False),
        ("psg", "views", False, True),
    ],
)
def test_inputs_that_a_strategy_can_have(name, vision, touch, accepted):
    assert STRATEGIES[name].accepts(vision, touch) == accepted


def test_a_new_strategy_is_one_row(monkeypatch, tmp_path):
    """It is planned, trained, kept, read and measured. It is a closed sphere that gets features of the nearest touches:
    no strategy of ours."""
    monkeypatch.setitem(STRATEGIES, "pooled_sphere", Strategy(touch_input="pooled", start="sphere"))
    experiment = Experiment("mine", "pooled_sphere", "occluded", True, 2)
    assert stages(experiment, training=True) == ["surface", "vision", "touch", "charts"]
    data = made_up()
    train(
        ReconstructionLearner(data, experiment, SETTINGS, 0), tmp_path / "model", tmp_path / "work", Machine("cpu"), ""
    )
    trained = load(tmp_path / "model/best.ckpt", tmp_path / "model/training.json", experiment, 0, "cpu")
    assert len(trained.model.faces) == 2304 and trained.model.faces.max() == 1153
    rows = evaluate(trained, data, 100, ["test"])
    assert len(rows) == data.grasps and np.isfinite(rows["chamfer"]).all() and (rows["gap"] == 0).all()
