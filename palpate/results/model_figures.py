"""Figures of the models' evaluations: error against grasps, against the distance from a touch, and training.

Bands and bars are 95 % bootstrap intervals, as in the tables; dashed lines are the paper's values.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import FormatStrFormatter, LogLocator, MaxNLocator, NullFormatter, PercentFormatter

from palpate.evaluation.rows import EvaluationError, read_table
from palpate.experiments import Experiment
from palpate.protocol import RINGS
from palpate.rebuild_command import rebuild_command
from palpate.results import model_tables as tables
from palpate.results import products
from palpate.results.bootstrap import RESAMPLES
from palpate.results.errors import errors
from palpate.results.page import COLOURS, LABEL, PALE, TITLE, Page, new_figure, save, styled
from palpate.results.published import paper_values

Experiments = tables.Experiments
HISTORY = ("step", "seconds", "train_loss", "validation_loss")
COLUMNS = 4  # panels beside each other
OTHER_LOSS = (tables.STRATEGY_NAMES["r2n2"],)  # trained by the cells' cross entropy, which has no place on the axis


@products.figure(evaluations="grasps")
@styled
def multi_grasp(
    evaluations: pd.DataFrame,
    experiments: Experiments,
    path: Path | str,
    split: str = "test",
    resamples: int = RESAMPLES,
) -> None:
    """Chamfer distance with more grasps, relative to that with one; bands are 95 % bootstrap intervals, dashed lines
    the paper's values.
    """
    found = errors(evaluations, list(experiments), split)
    published = paper_values("grasps").set_index("experiment")["value"]
    figure = new_figure(6, 4)
    axes = figure.add_axes((0.12, 0.13, 0.85, 0.78))
    for colour, (label, members) in zip(COLOURS, tables.setups(experiments).items(), strict=False):
        counts = sorted(members)
        first = members[counts[0]]
        estimates = [
            found.estimate([members[count], first], lambda means: means[..., 0] / means[..., 1] - 1, resamples)
            for count in counts
        ]
        _line(axes, counts, np.maximum(estimates, -1), colour, label)  # errors are not negative
        known = [count for count in counts if members[count] in published.index]
        if known and first in published.index:
            paper = [published[members[count]] / published[first] - 1 for count in known]
            axes.plot(known, paper, "--", color=colour, lw=1, label=f"{label} (paper)")
    axes.axhline(0, color=PALE, lw=0.8, zorder=0)
    _finish(axes, "Grasps", "Chamfer distance against one grasp", f"More grasps ({_size(found, split)})")
    axes.yaxis.set_major_formatter(PercentFormatter(1))
    save(figure, path)


@products.figure(rings="extrapolation")
@styled
def error_over_rings(
    rings: pd.DataFrame,
    experiments: Experiments,
    path: Path | str,
    split: str = "test",
    resamples: int = RESAMPLES,
) -> None:
    """Mean squared distance from the true surface to the prediction, in square rings around each touch: this run's,
    with 95 % bootstrap intervals, and the paper's. Each side has its own scale.
    """
    found = tables.ring_errors(rings, list(experiments), split)
    published = paper_values("extrapolation").set_index(["experiment", "ring"])["value"]
    figure = new_figure(9, 4)
    left, right = (figure.add_axes((x, 0.13, 0.41, 0.75)) for x in (0.075, 0.57))
    for colour, (name, setup) in zip(COLOURS, experiments.items(), strict=False):
        estimates = [found.estimate([tables.ring_key(name, ring)], resamples=resamples) for ring in RINGS]
        _line(left, RINGS, estimates, colour, tables.input_label(setup))
        paper = [published.get((name, ring), np.nan) for ring in RINGS]
        right.plot(RINGS, paper, "--o", color=colour, lw=1, ms=3.5, label=tables.input_label(setup))
    for axes, title in ((left, f"This run ({_size(found, split)})"), (right, "The paper")):
        _finish(axes, "Ring, in sensor sizes", "Mean squared distance, m²", title)
        axes.set_ylim(bottom=0)
        axes.title.set_y(1.03)
        axes.ticklabel_format(axis="y", style="sci", scilimits=(0, 0), useMathText=True)
    save(figure, path)


@products.figure(files=("histories",))
@styled
def training_curves(histories: Mapping[tuple[str, int], Path | str], experiments: Experiments, path) -> None:
    """Loss (9000 times the Chamfer distance, m²) of every training against its run time: on the validation split
    (solid) and in training (faint).

    histories: (experiment, seed) -> its `history.csv`. Raises EvaluationError, naming the file, if one is missing or
    lacks a column.
    """
    panels: dict[str, list[tuple[str, str, pd.DataFrame, bool]]] = {}
    losses, named = [], set()
    for (name, _), file in histories.items():
        panel, label, colour = _panel(experiments[name])
        history = _history(file)
        losses.append(history[["validation_loss"] if label in OTHER_LOSS else list(HISTORY[2:])])
        panels.setdefault(panel, []).append((label, colour, history, name not in named))
        named.add(name)
    bottom = min(part.min(axis=None) for part in losses) / 1.2
    top = max(part.max(axis=None) for part in losses) * 1.2
    columns = min(COLUMNS, len(panels))
    lines = -(-len(panels) // columns)
    page = Page(3.1 * columns + 0.2, 2.5 * lines + 0.3)
    for number, (title, curves) in enumerate(panels.items()):
        line, column = divmod(number, columns)
        axes = page.axes(column * 3.1 + 0.7, line * 2.5 + 0.35, 2.5, 1.9)
        for label, colour, history, first in curves:
            minutes = history["seconds"] / 60
            if label not in OTHER_LOSS:
                axes.plot(minutes, history["train_loss"], color=colour, lw=0.8, alpha=0.35)
            style = {"lw": 1.3, "marker": "o" if len(history) == 1 else None, "ms": 3}
            named_once = label if first else None
            axes.plot(minutes, history["validation_loss"], color=colour, label=named_once, **style)
        axes.set_yscale("log")
        axes.set_ylim(bottom, top)
        axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.yaxis.set_major_formatter(FormatStrFormatter("%g"))
        axes.yaxis.set_minor_formatter(NullFormatter())
        _finish(axes, "Minutes" if line == lines - 1 else "", "", title, integers=False)
    page.figure.text(0.012, 0.5, "Loss: Chamfer distance, m² x 9000", rotation=90, va="center", fontsize=LABEL)
    save(page.figure, path)


def _panel(setup: Experiment) -> tuple[str, str, str]:
    """The panel that an experiment's curve is in, its name there (its strategy, or how many grasps), its
    colour."""
    label, grasps = tables.input_label(replace(setup, architecture={})), setup.grasps
    if grasps > 1:
        return f"{label}, more grasps", f"{grasps} grasps", COLOURS[grasps % len(COLOURS)]
    name = tables.model_label(setup)
    # Strategies first; one with another architecture is a curve of its own.
    number = list(tables.STRATEGY_NAMES).index(setup.strategy) if name in tables.STRATEGY_NAMES.values() else -1
    return label, name, COLOURS[number % len(COLOURS)]


def _history(path: Path | str) -> pd.DataFrame:
    path = Path(path)
    if not path.exists():
        raise EvaluationError(f"{path} does not exist; train the model with: {rebuild_command(path)}")
    return read_table(path, HISTORY, f"remove it and train the model again with: {rebuild_command(path)}")


def _line(axes: Axes, x: Sequence[int], estimates: Sequence, colour: str, label: str) -> None:
    value, low, high = np.array(estimates).T
    axes.fill_between(x, low, high, color=colour, alpha=0.15, lw=0)
    axes.plot(x, value, "-o", color=colour, lw=1.6, ms=4, label=label)


def _finish(axes: Axes, x: str, y: str, title: str, integers: bool = True) -> None:
    axes.set_title(title, fontsize=TITLE if y else LABEL + 1)
    axes.set_xlabel(x, fontsize=LABEL)
    axes.set_ylabel(y, fontsize=LABEL)
    axes.tick_params(labelsize=LABEL - 1)
    axes.spines[["top", "right"]].set_visible(False)
    if integers:
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend(fontsize=LABEL - 1.5, frameon=False)


def _size(found, split: str) -> str:
    seeds = min(len(values) for values in found.values.values())
    return f"{split} split, {len(found.objects)} objects, {seeds} seed{'s' if seeds > 1 else ''}"
