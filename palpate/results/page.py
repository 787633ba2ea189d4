"""What the figures share: their look, and files whose bytes depend on the data only."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib.style
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

DPI = 130
INK, FAINT, PALE = "#222222", "#777777", "#bdbdbd"
# Okabe and Ito's colours (2008, Color Universal Design), apart for colour-blind readers too, and a grey.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#F0E442", "#000000", "#808080")
TITLE, LABEL = 11, 8.5  # points
# Not the user's: a figure is the same everywhere. DejaVu Sans comes with matplotlib.
STYLE = ["default", {"font.family": "DejaVu Sans", "text.color": INK, "axes.titlecolor": INK}]

styled = matplotlib.style.context(STYLE)  # a decorator


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of a size in inches; needs no display, and is not kept by pyplot."""
    figure = Figure(figsize=(width, height), dpi=DPI)
    FigureCanvasAgg(figure)
    return figure


def picture_grid(rows: Sequence[str], columns: Sequence[str], cell: float = 1.6) -> tuple[Figure, np.ndarray]:
    """A figure and its axes (rows, columns), without ticks and frames: a name left of each row, a title above each
    column. cell: inches of a picture."""
    figure = new_figure(cell * len(columns) + 0.3, cell * len(rows) + 0.4)
    figure.set_layout_engine("compressed")
    axes = figure.subplots(len(rows), len(columns), squeeze=False, subplot_kw={"xticks": [], "yticks": []})
    for panel in axes.flat:
        panel.spines[:].set_visible(False)
    for panel, title in zip(axes[0], columns, strict=True):
        panel.set_title(title, fontsize=TITLE - 1)
    for panel, name in zip(axes[:, 0], rows, strict=True):
        panel.set_ylabel(name, fontsize=LABEL, color=FAINT)
    return figure, axes


def save(figure: Figure, path: Path | str) -> None:
    """Write a PNG, without the name and version of what wrote it; a GIF if the path ends so."""
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    if Path(path).suffix == ".gif":
        return figure_image(figure).save(path, "GIF")
    figure.savefig(path, format="png", dpi=figure.dpi, metadata={"Software": None})


def figure_image(figure: Figure) -> Image.Image:
    """A figure as an image, RGB."""
    figure.canvas.draw()
    return Image.fromarray(np.asarray(figure.canvas.buffer_rgba())[..., :3])


@styled
def save_sentence(sentence: str, path: Path | str) -> None:
    """A figure that only states which data are missing."""
    figure = new_figure(5, 0.6)
    figure.text(0.5, 0.5, sentence, ha="center", va="center", fontsize=TITLE)
    save(figure, path)
