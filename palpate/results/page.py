"""What the figures share: their look, and files whose bytes depend on the data only."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from PIL.Image import Image

DPI = 130
INK, FAINT, PALE = "#222222", "#777777", "#bdbdbd"
# Okabe and Ito's colours (2008, Color Universal Design), apart for colour-blind readers too, and a grey.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#F0E442", "#000000", "#808080")
SENSOR_COLOURS = (COLOURS[1], COLOURS[0], *COLOURS[2:6])  # in the order of the sensors
TITLE, LABEL = 11, 8.5  # points
LINE = 0.17  # inches, of a line of either
# Not the user's: a figure is the same everywhere. DejaVu Sans comes with matplotlib.
STYLE = {"font.family": "DejaVu Sans", "text.color": INK, "axes.titlecolor": INK}


@contextmanager
def _style() -> Iterator[None]:
    import matplotlib.style

    with matplotlib.style.context(("default", STYLE)):
        yield


styled = _style()  # a decorator of what draws


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of a size in inches; needs no display, and is not kept by pyplot."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), dpi=DPI)


def picture_grid(rows: Sequence[str], columns: Sequence[str], cell: float = 1.6) -> tuple[Figure, np.ndarray]:
    """A figure and its axes (rows, columns), without ticks and frames: a name left of each row, a title above each
    column, in lines no longer than a picture. cell: inches of a picture."""
    labels, titles = [wrapped(name, cell, LABEL) for name in rows], [wrapped(name, cell, TITLE - 1) for name in columns]

    def more_breaks(texts: Sequence[str], than: Sequence[str]) -> int:
        return max(text.count("\n") for text in texts) - max(text.count("\n") for text in than)

    width = cell * len(columns) + 0.3 + LINE * more_breaks(labels, rows)
    figure = new_figure(width, cell * len(rows) + 0.4 + LINE * more_breaks(titles, columns))
    figure.set_layout_engine("compressed")
    axes = figure.subplots(len(rows), len(columns), squeeze=False, subplot_kw={"xticks": [], "yticks": []})
    for panel in axes.flat:
        panel.spines[:].set_visible(False)
    for panel, title in zip(axes[0], titles, strict=True):
        panel.set_title(title, fontsize=TITLE - 1)
    for panel, name in zip(axes[:, 0], labels, strict=True):
        panel.set_ylabel(name, fontsize=LABEL, color=FAINT)
    return figure, axes


def wrapped(text: str, inches: float, size: float) -> str:
    """A text in lines that are at most so wide, in points `size` of the figures' font."""
    from matplotlib.textpath import TextPath

    lines = []
    for line in text.split("\n"):
        width = TextPath((0, 0), line, size=size).get_extents().width / 72 if line.strip() else 0
        lines += textwrap.wrap(line, max(1, int(len(line) * inches / width))) if width > inches else [line]
    return "\n".join(lines)


def save(figure: Figure, path: Path | str) -> None:
    """Write a PNG, without the name and version of what wrote it; a GIF if the path ends so."""
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    if Path(path).suffix == ".gif":
        return figure_image(figure).save(path, "GIF")
    figure.savefig(path, format="png", dpi=figure.dpi, metadata={"Software": None})


def figure_image(figure: Figure) -> Image:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])


def next_page(figure: Figure) -> Image:
    """A page of an animation, RGB: the figure as it is. Its pictures are then removed, and its layout stays."""
    page = figure_image(figure)
    figure.set_layout_engine("none")  # all pages are laid out as the first is
    for panel in figure.axes:
        panel.images[0].remove()
    return page


def save_animation(pages: Sequence[Image], path: Path | str, pause: int, rest: int) -> None:
    """Write pages as a GIF that repeats; pause, rest: ms that a page is shown, and the last one."""
    palette = pages[-1].quantize(255)  # of all: else colours flicker, and every pixel is written again
    first, *others = (page.quantize(palette=palette) for page in pages)
    times = [pause] * len(others) + [rest]
    first.save(path, "GIF", save_all=True, append_images=others, duration=times, loop=0, optimize=True)


@styled
def save_sentence(sentence: str, path: Path | str) -> None:
    """A figure that only states which data are missing."""
    sentence = wrapped(sentence, 4.6, TITLE)
    figure = new_figure(5, 0.4 + 0.2 * len(sentence.splitlines()))
    figure.text(0.5, 0.5, sentence, ha="center", va="center", fontsize=TITLE)
    save(figure, path)
