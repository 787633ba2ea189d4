"""What the figures share: their look, and files whose bytes depend on the data only."""

from pathlib import Path

import matplotlib.style
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

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


def save(figure: Figure, path: Path | str) -> None:
    """Write a PNG, without the name and version of what wrote it."""
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, format="png", dpi=figure.dpi, metadata={"Software": None})


@styled
def save_sentence(sentence: str, path: Path | str) -> None:
    """A figure that only states which data are missing."""
    figure = new_figure(5, 0.6)
    figure.text(0.5, 0.5, sentence, ha="center", va="center", fontsize=TITLE)
    save(figure, path)
