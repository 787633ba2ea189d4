"""Figures of the models' evaluations: error against grasps, against the distance from a touch, and training.

Bands and bars are 95 % bootstrap intervals, as in the tables; dashed lines are the paper's values.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import FormatStrFormatter, LogLocator, MaxNLocator, NullFormatter, PercentFormatter

from palpate.evaluation.rows import EvaluationError, read_table
from palpate.experiments import Experiment
from palpate.protocol import RINGS
from palpate.rebuild_command import rebuild_command
from palpate.results import methods, products
from palpate.results import model_tables as tables
from palpate.results.bootstrap import RESAMPLES
from palpate.results.errors import errors
from palpate.results.page import COLOURS, LABEL, PALE, TITLE, Page, new_figure, save, styled
from palpate.results.published import paper_values

Experiments = tables.Experiments
HISTORY = ("step", "seconds", "train_loss", "validation_loss")
COLUMNS = 4  # panels beside each other
OTHER_LOSS = (methods.NAMES["r2n2"][0],)  # trained by the cells' cross entropy, which has no place on the axis
ORDER = ("charts", "pooled", "implicit", "sphere", "no_comm", "no_copy", "mean", "retrieval")  # of colours
PANEL = {"left": 0.075, "right": 0.99, "bottom": 0.13, "top": 0.88}  # of the width and height of a row of panels


@products.figure(evaluations="grasps")
@styled
def multi_grasp(evaluations: tables.Frame, experiments: Experiments, path, split="test", resamples=RESAMPLES) -> None:
    """Chamfer distance with more grasps, relative to that with one, for each method and input; bands are 95 % bootstrap
    intervals, dashed lines the paper's values.
    """
    found = errors(evaluations, list(experiments), split)
    published = paper_values("grasps").set_index("experiment")["value"]
    setups = tables.setups(experiments)
    inputs = list(dict.fromkeys(label for _, label in setups))
    figure = new_figure(5 * len(inputs) + 1, 4)
    panels = figure.subplots(1, len(inputs), squeeze=False, sharey=True, gridspec_kw=PANEL)[0]
    for (method, label), members in setups.items():
        axes, counts = panels[inputs.index(label)], sorted(members)
        first = members[counts[0]]
        style = _style(experiments[first])
        estimates = [
            found.estimate([members[count], first], lambda means: means[..., 0] / means[..., 1] - 1, resamples)
            for count in counts
        ]
        _line(axes, counts, np.maximum(estimates, -1), style, method)  # errors are not negative
        known = [count for count in counts if members[count] in published.index]
        if known and first in published.index:
            paper = [published[members[count]] / published[first] - 1 for count in known]
            axes.plot(known, paper, "--", color=style["color"], lw=1, label="the paper's values")
    for axes, label in zip(panels, inputs, strict=True):
        axes.axhline(0, color=PALE, lw=0.8, zorder=0)
        _finish(axes, "Grasps", "Chamfer distance against one grasp", f"{label} ({_size(found, split)})")
        axes.yaxis.set_major_formatter(PercentFormatter(1))
    save(figure, path)


@products.figure(selections="grasp_selection", on_request=True)
@styled
def grasp_selection(
    selections: tables.Frame, experiments: Experiments, path, split="test", resamples=RESAMPLES
) -> None:
    """Chamfer distance after each grasp that a strategy chose among those stored, relative to the first, with 95 %
    bootstrap intervals. The oracle takes the grasp that leaves the least error.
    """
    found, chosen = tables.selection_errors(selections, experiments, split)
    figure = new_figure(5 * len(experiments) + 1, 4)
    panels = figure.subplots(1, len(experiments), squeeze=False, sharey=True, gridspec_kw=PANEL)[0]
    for axes, (name, setup) in zip(panels, experiments.items(), strict=True):
        of_model = {strategy: keys for (model, strategy), keys in chosen.items() if model == name}
        for colour, (strategy, keys) in zip(COLOURS, of_model.items(), strict=False):
            first = next(iter(keys.values()))
            estimates = [
                found.estimate([key, first], lambda means: means[..., 0] / means[..., 1] - 1, resamples)
                for key in keys.values()
            ]
            _line(axes, list(keys), np.maximum(estimates, -1), {"color": colour}, strategy)
        _finish(
            axes,
            "Chosen grasps",
            "Chamfer distance against the first",
            f"{methods.label(setup)}, {methods.input_label(setup)}",
        )
        axes.yaxis.set_major_formatter(PercentFormatter(1))
    save(figure, path)


@products.figure(rings="extrapolation")
@styled
def error_over_rings(rings: tables.Frame, experiments: Experiments, path, split="test", resamples=RESAMPLES) -> None:
    """Mean squared distance from the true surface to the prediction, in square rings around each touch: this run's,
    with 95 % bootstrap intervals, for occluded and unoccluded vision; and the paper's. Charts without communication are
    copied into the mesh and change nothing else. Each panel has its own scale.
    """
    found = tables.ring_errors(rings, list(experiments), split)
    published = paper_values("extrapolation").set_index(["experiment", "ring"])["value"]
    images = list(dict.fromkeys(each.vision for each in experiments.values()))
    figure = new_figure(4.5 * len(images) + 4.5, 5.2)
    *panels, papers = figure.subplots(1, len(images) + 1, gridspec_kw=PANEL | {"bottom": 0.4, "top": 0.9})
    for name, setup in experiments.items():
        place, inputs = images.index(setup.vision), methods.input_label(setup)
        estimates = [found.estimate([tables.ring_key(name, ring)], resamples=resamples) for ring in RINGS]
        method = methods.label(setup) if setup.touch else f"vision alone, {methods.label(setup)}"
        _line(panels[place], RINGS, estimates, _style(setup), method)
        if (name, RINGS[0]) in published:
            paper = [published[name, ring] for ring in RINGS]
            papers.plot(RINGS, paper, "--o", color=COLOURS[2 * place + setup.touch], lw=1, ms=3.5, label=inputs)
    titles = [f"{image} vision ({_size(found, split)})" for image in images]
    for axes, title in zip([*panels, papers], [*titles, "The paper"], strict=True):
        _finish(axes, "Ring, in sensor sizes", "Mean squared distance, m²", title)
        axes.set_ylim(bottom=0)
        axes.title.set_y(1.03)
        axes.ticklabel_format(axis="y", style="sci", scilimits=(0, 0), useMathText=True)
        axes.get_legend().set(loc="upper center", bbox_to_anchor=(0.5, -0.15))  # no place inside is free of lines
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
    """The panel that an experiment's curve is in, its name there (its method, or how many grasps), its colour."""
    label, grasps = methods.input_label(setup), setup.grasps
    if grasps > 1 and not setup.fewer_grasps:
        return f"{label}, more grasps", f"{grasps} grasps, {methods.label(setup)}", COLOURS[grasps % len(COLOURS)]
    return label, methods.label(setup), _style(setup)["color"]


def _style(setup: Experiment) -> dict[str, str]:
    """Colour and dashes of a line: vision alone is dotted, a model without its correction dash-dotted."""
    method = methods.method_of(setup)
    plain = method.removesuffix(methods.UNCORRECTED)
    number = ORDER.index(plain) if plain in ORDER else list(methods.NAMES).index(plain)
    dashes = "-." if plain != method else "-" if setup.touch else ":"
    return {"color": COLOURS[number % len(COLOURS)], "linestyle": dashes}


def _history(path: Path | str) -> pd.DataFrame:
    path = Path(path)
    if not path.exists():
        raise EvaluationError(f"{path} does not exist; train the model with: {rebuild_command(path)}")
    return read_table(path, HISTORY, f"remove it and train the model again with: {rebuild_command(path)}")


def _line(axes: Axes, x: Sequence[int], estimates: Sequence, style: dict[str, str], label: str) -> None:
    value, low, high = np.array(estimates).T
    axes.fill_between(x, low, high, color=style["color"], alpha=0.12, lw=0)
    axes.plot(x, value, marker="o", lw=1.6, ms=4, label=label, **style)


def _finish(axes: Axes, x: str, y: str, title: str, integers: bool = True) -> None:
    axes.set_title(title, fontsize=TITLE if y else LABEL + 1)
    axes.set_xlabel(x, fontsize=LABEL)
    axes.set_ylabel(y, fontsize=LABEL)
    axes.tick_params(labelsize=LABEL - 1)
    axes.spines[["top", "right"]].set_visible(False)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True) if integers else MaxNLocator(4))
    axes.legend(fontsize=LABEL - 1.5, frameon=False)


def _size(found, split: str) -> str:
    seeds = max(len(values) for values in found.values.values())
    counted = (len(found.objects), "object"), (seeds, "seed")
    counts = (f"{count} {what}{'s' * (count != 1)}" for count, what in counted)
    return ", ".join([f"{split} split", *counts])
