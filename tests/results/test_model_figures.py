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


def last_row(half: np.ndarray, colour: str) -> float:
    """The row, in pixels, of the last point of a line of just this colour: of its marker's middle."""
    rows, columns = np.nonzero(np.abs(half - np.array(to_rgb(colour))).max(axis=2) < 0.01)
    return rows[columns >= columns.max() - 3].mean()


@pytest.fixture(scope="module")
def evaluations():
    return synthetic.evaluations(synthetic.means_of_tables(), each=4, windows=1)


def test_lines_go_where_their_numbers_say(tmp_path, evaluations):
    """Both panels have one scale; with touch alone the line falls about four times as far as with vision."""
    setup = {name: row for name, row in synthetic.of_table("grasps").items() if row.strategy == "charts"}
    figures.multi_grasp(evaluations, setup, tmp_path / "a.png", resamples=50)
    halves = np.array_split(imread(tmp_path / "a.png")[..., :3], 2, axis=1)
    zero = [last_row(half, figures.PALE) for half in halves]
    assert zero[0] == zero[1]
    vision, touch = (last_row(half, figures.COLOURS[0]) - zero[0] for half in halves)
    mean = evaluations[evaluations["split"] == "test"].groupby("experiment")["chamfer"].mean()
    change = {name: mean[f"{name}_5"] / mean[name] - 1 for name in ("charts_unoccluded_touch", "charts_touch")}
    assert touch / vision == pytest.approx(change["charts_touch"] / change["charts_unoccluded_touch"], rel=0.05)


def test_the_same_numbers_give_the_same_bytes(tmp_path, evaluations):
    rings = synthetic.rings(synthetic.published_rings(), each=4)
    setup = synthetic.of_table("grasps")
    for name in ("a", "b"):
        figures.multi_grasp(evaluations, setup, tmp_path / f"{name}1.png", resamples=50)
        figures.error_over_rings(rings, synthetic.of_table("extrapolation"), tmp_path / f"{name}2.png", resamples=50)
    for number in (1, 2):
        assert (tmp_path / f"a{number}.png").read_bytes() == (tmp_path / f"b{number}.png").read_bytes()


def test_chosen_grasps_fall_by_what_their_numbers_say(tmp_path):
    """To -25 % at random, to -50 % by the oracle."""
    means = {("a", "random"): [1.0, 0.75], ("a", "oracle"): [1.0, 0.5]}
    setup = {"a": Experiment("a", "pooled", "unoccluded", True, 1)}
    figures.grasp_selection(synthetic.selections(means, spread=1e-4), setup, tmp_path / "a.png", resamples=50)
    image = imread(tmp_path / "a.png")[..., :3]
    rows = [last_row(image[:, image.shape[1] // 2 :], colour) for colour in (*figures.COLOURS[:2], figures.PALE)]
    assert (rows[1] - rows[2]) / (rows[0] - rows[2]) == pytest.approx(2, rel=0.05)


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
    # At least two lines of four kinds of input, against one.
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


def test_methods_are_curves_of_their_own_beside_each_other():
    charts = Experiment("charts", strategy="charts", vision="occluded", touch=True, grasps=1)
    names = ("charts", "pooled", "implicit", "sphere", "no_copy", "no_comm", "pooled_no_copy")
    panels, labels, colours = zip(*(figures._panel(replace(charts, strategy=name)) for name in names), strict=True)
    assert set(panels) == {"occluded vision + touch"} and len({*labels}) == len({*colours}) == len(names)
