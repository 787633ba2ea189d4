"""A model through the whole workflow: killed while it trains, it ends as if it had not been."""

import json
import shutil

import pandas as pd
import trimesh

from palpate.command import main

MODEL = "models/charts_touch/seed-0"
EVALUATION = "evaluations/charts_touch/seed-0.csv"
STEPS = 40


TRAINING = {
    "device": "cpu",
    "override": {
        "touch_depth": {"width": 4, "steps": 4, "evaluate_every": 2, "batch": 2},
        "reconstruction": {
            "steps": STEPS,
            "evaluate_every": 10,
            "batch": 1,
            "loss_points": 200,
            "validation_points": 200,
            "architecture": {"gcn": {"layers": 3, "width": 16}},
        },
    },
}


def test_a_training_that_was_killed_goes_on_to_the_same_model(finished, tmp_path):
    """A few steps of a small network, on a copy of the run, an object a split. There are no images."""
    workflow = finished.copied(tmp_path, training=TRAINING, evaluation={"points": 1000, "resamples": 100})
    for folder in ("vision", "rejected/vision"):
        shutil.rmtree(workflow.run / folder)
    result = workflow(EVALUATION)
    assert result.returncode == 0, result.stderr
    assert not (workflow.run / "vision").exists() and not (workflow.run / "views").exists()

    # The model and its evaluation once more, from the same data.
    model, evaluation = workflow.run / MODEL, workflow.run / EVALUATION
    uninterrupted = model.rename(workflow.run / "uninterrupted")
    evaluation = evaluation.rename(uninterrupted / "evaluation.csv")
    workflow.kill_when("checkpoints/charts_touch/seed-0/last.ckpt", EVALUATION)
    assert not (model / "best.ckpt").exists()
    result = workflow(EVALUATION)
    assert result.returncode == 0, result.stderr
    assert "continues from" in (workflow.run / "logs/reconstruction/charts_touch-0.log").read_text()

    assert (model / "best.ckpt").read_bytes() == (uninterrupted / "best.ckpt").read_bytes()
    histories = [pd.read_csv(folder / "history.csv").drop(columns="seconds") for folder in (model, uninterrupted)]
    pd.testing.assert_frame_equal(*histories, check_exact=True)
    assert histories[0].step.max() == STEPS
    errors = [pd.read_csv(path).drop(columns="seconds") for path in (workflow.run / EVALUATION, evaluation)]
    pd.testing.assert_frame_equal(*errors, check_exact=True)
    assert set(errors[0].split) == {"validation", "test"}
    assert json.loads((model / "training.json").read_text())["steps"] == STEPS

    mesh = workflow.run / "can.ply"
    assert main(["reconstruct", str(workflow.run), "charts_touch", "can-tall", "--output", str(mesh)]) == 0
    assert len(trimesh.load(mesh).faces) >= 96 * 24
