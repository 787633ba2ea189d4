import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.image import imread

from palpate.experiments import Experiment
from palpate.results import model_figures as figures
from tests.learning import synthetic


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
    setup = {"a": Experiment("a", "template", "unoccluded", True, 1)}
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


def test_each_method_has_a_colour_of_its_own():
    assert len(set(figures.COLOURS)) == len(figures.COLOURS) >= len(figures.ORDER)
