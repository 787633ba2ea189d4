"""Pictures in a grid: names beside and above them are whole, also long ones."""

import numpy as np
import pytest
from PIL import Image

from palpate.results.page import picture_grid, save_sentence, styled, wrapped

LONG = "wooden_kitchen_table-model_normalized_2f1a9c_v2, grasp 12"
ROWS = ["bottle-0011, grasp 3", "cellphone-0008, grasp 2", LONG, "W" * 60]
COLUMNS = ["unoccluded", "unoccluded\nimage", "sensor_of_the_index_fingers_last_phalanx"]


@styled
def drawn(rows, columns, cell):
    figure, axes = picture_grid(rows, columns, cell)
    for panel in axes.flat:
        panel.imshow(np.zeros((4, 4, 3)))
    figure.draw_without_rendering()
    return figure, axes


@pytest.mark.parametrize("cell", [1.3, 1.6])
@pytest.mark.parametrize("rows", [ROWS, ROWS[2:3]], ids=["many", "one"])
def test_names_are_within_the_figure_and_no_longer_than_their_picture(rows, cell):
    figure, axes = drawn(rows, COLUMNS, cell)
    size, most = figure.canvas.get_width_height(), 1.05 * cell * figure.dpi
    labels = [panel.yaxis.label for panel in axes[:, 0]] + [panel.title for panel in axes[0]]
    for label, name in zip(labels, [*rows, *COLUMNS], strict=True):
        box = label.get_window_extent()
        assert min(box.x0, box.y0) >= 0 and box.x1 <= size[0] and box.y1 <= size[1], name
        assert (box.width if name in COLUMNS else box.height) <= most, name
        assert "".join(label.get_text().split()) == "".join(name.split())


@styled
def test_what_fits_stays_in_its_lines():
    for name in (*ROWS[:2], *COLUMNS[:2], ""):
        assert wrapped(name, 1.6, 8.5) == name


def test_a_long_sentence_is_whole(tmp_path):
    for count in (1, 9):
        save_sentence("No usable object of class " + count * "kitchen_tables_" + " in this run", tmp_path / "a.png")
        ink = np.argwhere(np.asarray(Image.open(tmp_path / "a.png").convert("L")) < 200)
        height, width = Image.open(tmp_path / "a.png").size[::-1]
        assert (ink.min(axis=0) > 5).all() and (ink.max(axis=0) < (height - 5, width - 5)).all()
