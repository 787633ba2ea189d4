import shutil

import matplotlib
import numpy as np
import pytest
from PIL import Image

from palpate import Dataset, store
from palpate.results import dataset_figures as figures
from palpate.results.dataset_figures import data_point, example_grasp, examples

LARGEST = 500_000  # bytes of a figure's file


def pixels(path):
    return np.asarray(Image.open(path).convert("RGB")).astype(int)


def test_a_data_point_shows_the_images_of_its_grasp(dataset, tmp_path):
    data_point(dataset, tmp_path / "figures" / "data_point.png")
    picture = pixels(tmp_path / "figures" / "data_point.png")
    middle = picture.shape[0] // 2
    assert (picture[middle, 100] == 90).all()  # the fixture's occluded images, then its unoccluded ones
    assert (picture[middle, 480] == 200).all()
    assert (tmp_path / "figures" / "data_point.png").stat().st_size < LARGEST


def test_sensors_have_the_names_of_the_runs_own_hand(run, tmp_path, monkeypatch):
    names = ["left", "right", "high", "low"]
    copy = shutil.copytree(run, tmp_path / "run")
    path = copy / "grasps" / "batch-0000.h5"
    arrays, attributes = store.read(path), store.open(path).attributes
    store.write(path, "grasps", arrays | {"hand/sensor_names": np.array(names)}, attributes)
    drawn = []
    monkeypatch.setattr(figures, "save", lambda figure, path: drawn.append(figure))
    data_point(Dataset(copy), tmp_path / "point.png")
    examples(Dataset(copy), "bottle", tmp_path / "sheet.png")
    point, sheet = drawn
    assert [axes.get_title().split(":")[0] for axes in point.axes[2:6]] == names
    assert [text.get_text() for text in sheet.texts[2:6]] == names


def test_a_sheet_has_a_row_an_object_with_all_its_parts(dataset, tmp_path):
    examples(dataset, "bottle", tmp_path / "two.png")
    examples(dataset, "knife", tmp_path / "one.png")
    two, one = pixels(tmp_path / "two.png"), pixels(tmp_path / "one.png")
    cell = 1.55 * figures.SHEET_DPI
    assert two.shape[0] - one.shape[0] == pytest.approx(1.79 * figures.SHEET_DPI, abs=1)
    # From the bottom up: the middle of each row's first two cells.
    for row in range(2):
        middle = round(two.shape[0] - cell / 2 - row * 1.79 * figures.SHEET_DPI)
        assert (two[middle, round(cell / 2)] == 200).all()
        assert (two[middle, round(1.5 * cell)] == 90).all()
        # Readings and surface are there: neither blank nor grey.
        assert np.ptp(two[middle, round(2.2 * cell) : round(6 * cell)], axis=-1).max() > 30
        assert (two[middle - 30 : middle + 30, round(6.3 * cell) :] < 250).any()
    assert (tmp_path / "two.png").stat().st_size < LARGEST


@pytest.mark.parametrize("draw", [data_point, lambda d, path: examples(d, "knife", path)])
def test_a_figure_has_the_same_bytes_every_time_whatever_the_users_style(dataset, tmp_path, draw):
    draw(dataset, tmp_path / "a.png")
    with matplotlib.rc_context({"figure.facecolor": "black", "font.size": 30, "savefig.bbox": "tight"}):
        draw(dataset, tmp_path / "b.png")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert Image.open(tmp_path / "a.png").text == {}


def test_a_sheet_takes_objects_from_all_over_the_class(dataset, tmp_path, monkeypatch):
    monkeypatch.setattr(figures, "EXAMPLES", 1)
    examples(dataset, "bottle", tmp_path / "one.png")
    monkeypatch.setattr(figures, "EXAMPLES", 6)
    examples(dataset.select(["bottle-0000"]), "bottle", tmp_path / "first.png")
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "first.png").read_bytes()


@pytest.mark.parametrize("count, most", [(1, 6), (6, 6), (7, 6), (100, 6), (100, 1)])
def test_evenly(count, most):
    numbers = figures._evenly(count, most)
    assert len(set(numbers)) == len(numbers) == min(count, most)
    assert numbers[0] == 0 and (most == 1 or numbers[-1] == count - 1)
    assert np.ptp(np.diff(numbers)) <= 1 if len(numbers) > 1 else True


def test_the_example_has_as_many_touches_as_is_best(dataset):
    counts = [int(grasp.success.sum()) for record in dataset for grasp in record.grasps]
    best = next(count for count in figures.best_counts(4) if count in counts)
    assert example_grasp(dataset).success.sum() == best


def test_the_example_does_not_depend_on_batches_or_order_of_reading(dataset):
    first, second = example_grasp(dataset), example_grasp(Dataset(dataset["knife-0000"].mesh.parents[2]))
    assert (first.object.name, first.number) == (second.object.name, second.number)


@pytest.mark.parametrize("class_name", ["sock", "teapot"])
def test_a_class_without_objects_is_said_to_have_none(dataset, tmp_path, class_name):
    """All socks were rejected; teapots never were in the catalogue."""
    examples(dataset, class_name, tmp_path / "none.png")
    height, width, _ = pixels(tmp_path / "none.png").shape
    assert height < 100 and width > 300


def test_a_run_without_usable_objects_has_its_figures(run, tmp_path):
    shutil.copy(run / "catalogue.csv", tmp_path)
    names = [line.split(",")[0] for line in (run / "catalogue.csv").read_text().splitlines()[1:]]
    (tmp_path / "rejected.csv").write_text("object,stage,reason\n" + "".join(f"{n},meshes,x\n" for n in names))
    empty = Dataset(tmp_path)
    data_point(empty, tmp_path / "data_point.png")
    examples(empty, "bottle", tmp_path / "examples.png")
    assert pixels(tmp_path / "data_point.png").shape[0] < 100
    assert pixels(tmp_path / "examples.png").min() < 100  # there is a sentence
