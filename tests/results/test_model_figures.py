from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_rgb
from matplotlib.image import imread

from palpate.evaluation.rows import EvaluationError
from palpate.experiments import Experiment
from palpate.results import model_figures as figures
from tests.evaluation import synthetic


def history(path, losses=(20.0, 5.0, 2.0)):
    path.parent.mkdir(parents=True, exist_ok=True)
    steps = np.arange(1, len(losses) + 1)
    columns = {"step": 50 * steps, "seconds": 60.0 * steps, "train_loss": losses, "validation_loss": losses}
    pd.DataFrame(columns).to_csv(path, index=False)
    return path


def drawn(path) -> np.ndarray:
    """(h, w) bool: pixels that are coloured, neither grey nor white."""
    image = imread(path)[..., :3]
    return np.ptp(image, axis=2) > 0.2


def rows_of(path, colour: str) -> np.ndarray:
    """Rows that hold a pixel of just this colour."""
    image = imread(path)[..., :3]
    return np.flatnonzero((np.abs(image - np.array(to_rgb(colour))).max(axis=2) < 0.01).any(axis=1))


@pytest.fixture(scope="module")
def evaluations():
    return synthetic.evaluations(synthetic.published_means(), each=4, windows=1)


def test_lines_go_where_their_numbers_say(tmp_path, evaluations):
    """Both start at 0; that of touch alone falls to -59 %, far below the other."""
    figures.multi_grasp(evaluations, synthetic.of_table("grasps"), tmp_path / "a.png", resamples=50)
    vision, touch = (rows_of(tmp_path / "a.png", colour) for colour in figures.COLOURS[:2])
    assert abs(vision.min() - touch.min()) <= 8  # a marker is drawn over the other
    assert touch.max() - touch.min() > 300 and touch.max() > vision.max() + 100


def test_the_same_numbers_give_the_same_bytes(tmp_path, evaluations):
    rings = synthetic.rings(synthetic.published_rings(), each=4)
    setup = synthetic.of_table("grasps")
    for name in ("a", "b"):
        figures.multi_grasp(evaluations, setup, tmp_path / f"{name}1.png", resamples=50)
        figures.error_over_rings(rings, synthetic.of_table("extrapolation"), tmp_path / f"{name}2.png", resamples=50)
    for number in (1, 2):
        assert (tmp_path / f"a{number}.png").read_bytes() == (tmp_path / f"b{number}.png").read_bytes()


def test_both_sides_of_the_rings_hold_their_lines(tmp_path):
    rings = synthetic.rings(synthetic.published_rings(), each=4)
    figures.error_over_rings(rings, synthetic.of_table("extrapolation"), tmp_path / "a.png", resamples=50)
    coloured = drawn(tmp_path / "a.png")
    middle = coloured.shape[1] // 2
    assert coloured[:, :middle].sum() > 1000 and coloured[:, middle:].sum() > 500


def test_every_kind_of_training_has_its_panel(tmp_path):
    files = {
        (name, seed): history(tmp_path / name / f"seed-{seed}" / "history.csv")
        for name in synthetic.EXPERIMENTS
        for seed in (0, 1)
    }
    figures.training_curves(files, synthetic.EXPERIMENTS, tmp_path / "all.png")
    few = {key: path for key, path in files.items() if key[0] == "charts_touch"}
    figures.training_curves(few, synthetic.EXPERIMENTS, tmp_path / "one.png")
    whole, one = imread(tmp_path / "all.png"), imread(tmp_path / "one.png")
    # Eight kinds of input in two lines of four, against one.
    assert whole.shape[0] > 1.8 * one.shape[0] and whole.shape[1] > 3.5 * one.shape[1]


def test_a_training_of_one_evaluation_is_still_seen(tmp_path):
    path = history(tmp_path / "history.csv", losses=(3.0,))
    figures.training_curves({("charts_touch", 0): path}, synthetic.EXPERIMENTS, tmp_path / "a.png")
    assert drawn(tmp_path / "a.png").any()


def test_a_history_that_is_missing_or_broken_is_named(tmp_path):
    path = tmp_path / "models/charts_touch/seed-0/history.csv"
    with pytest.raises(EvaluationError, match="snakemake models/charts_touch/seed-0/history.csv"):
        figures.training_curves({("charts_touch", 0): path}, synthetic.EXPERIMENTS, tmp_path / "a.png")
    path.parent.mkdir(parents=True)
    path.write_text("step,seconds\n1,2\n")
    with pytest.raises(EvaluationError, match="train_loss"):
        figures.training_curves({("charts_touch", 0): path}, synthetic.EXPERIMENTS, tmp_path / "a.png")


def test_the_papers_graph_is_a_curve_of_its_own_beside_the_others():
    charts = Experiment("charts", strategy="charts", vision="occluded", touch=True, grasps=1)
    graph = replace(charts, architecture={"touch": "graph"})
    (panel, label, colour), (its_panel, its_label, its_colour) = map(figures._panel, (charts, graph))
    assert its_panel == panel and its_label != label and its_colour != colour
    every = [figures._panel(replace(charts, strategy=name)) for name in ("sphere", "no_copy", "no_comm")]
    assert its_colour not in [colour for _, _, colour in every]
