"""What the figures share: their look, and files whose bytes depend on the data only."""

from pathlib import Path

import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

DPI = 130
INK, FAINT, PALE = "#222222", "#777777", "#bdbdbd"
# Okabe and Ito's colours (2008, Color Universal Design), apart for colour-blind readers too.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#F0E442", "#000000")
TITLE, LABEL = 11, 8.5  # points
# Not the user's: a figure is the same everywhere. DejaVu Sans comes with matplotlib.
STYLE = ["default", {"font.family": "DejaVu Sans", "text.color": INK, "axes.titlecolor": INK}]

styled = matplotlib.style.context(STYLE)  # a decorator


def new_figure(width: float, height: float, dpi: int = DPI) -> Figure:
    """An empty figure of a size in inches; needs no display, and is not kept by pyplot."""
    figure = Figure(figsize=(width, height), dpi=dpi)
    FigureCanvasAgg(figure)
    return figure


class Page:
    """A figure of a size in inches. Places on it are inches from its top left corner."""

    def __init__(self, width: float, height: float, dpi: int = DPI):
        self.width, self.height, self.figure = width, height, new_figure(width, height, dpi)

    def axes(self, x: float, y: float, width: float, height: float, shown: bool = True) -> Axes:
        """Axes with their top left corner at (x, y); shown: whether they have a frame and ticks."""
        place = x / self.width, 1 - (y + height) / self.height, width / self.width, height / self.height
        axes = self.figure.add_axes(place)
        if not shown:
            axes.set_axis_off()
        return axes

    def text(self, x: float, y: float, words: str, **style) -> None:
        """Words about (x, y)."""
        self.figure.text(x / self.width, 1 - y / self.height, words, **{"ha": "center", "va": "center"} | style)


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
