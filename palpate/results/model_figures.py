"""Figures of the models' evaluations: error against grasps, and against the distance from a touch.

Bands and bars are 95 % bootstrap intervals, as in the tables; dashed lines are the paper's values.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.experiments import Experiment
from palpate.methods import METHODS
from palpate.protocol import RINGS
from palpate.results import model_tables as tables
from palpate.results import products
from palpate.results.bootstrap import RESAMPLES
from palpate.results.errors import Errors, errors, ratio
from palpate.results.page import COLOURS, LABEL, PALE, TITLE, new_figure, save
from palpate.results.published import stated

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike
    from pandas import DataFrame as Frame

# Of colours.
ORDER = ("charts", "pooled", "template", "pooled_no_copy", "sphere", "no_comm", "no_copy", "mean", "retrieval")
PANEL = {"left": 0.075, "right": 0.99, "bottom": 0.13, "top": 0.88}  # of the width and height of a row of panels


@products.figure(evaluations="grasps")
def multi_grasp(
    evaluations: Frame,
    experiments: tables.Experiments,
    path: Path | str,
    split: str = "test",
    resamples: int = RESAMPLES,
) -> None:
    """Chamfer distance with more grasps, relative to that with one, for each method and input; bands are 95 % bootstrap
    intervals, dashed lines the paper's values.
    """
    measured = errors(evaluations, list(experiments), split)
    published = stated("grasps")
    setups = tables.setups(experiments)
    inputs = list(dict.fromkeys(label for _, label in setups))
    figure = new_figure(5 * len(inputs) + 1, 4)
    panels = figure.subplots(1, len(inputs), squeeze=False, sharey=True, gridspec_kw=PANEL)[0]
    for (method, label), members in setups.items():
        axes, keys = panels[inputs.index(label)], dict(sorted(members.items()))
        first = next(iter(keys.values()))
        style = _style(experiments[first])
        _line(axes, list(keys), _against_first(measured, keys, resamples), style, method)
        if first in published:
            paper = {count: published[key] / published[first] - 1 for count, key in keys.items() if key in published}
            axes.plot([*paper], [*paper.values()], "--", color=style["color"], lw=1, label="the paper's values")
    for axes, label in zip(panels, inputs, strict=True):
        axes.axhline(0, color=PALE, lw=0.8, zorder=0)
        _finish(
            axes, "Grasps", "Chamfer distance against one grasp", f"{label} ({_size(measured, split)})", percent=True
        )
    save(figure, path)


@products.figure(selections="grasp_selection", on_request=True)
def grasp_selection(
    selections: Frame,
    experiments: tables.Experiments,
    path: Path | str,
    split: str = "test",
    resamples: int = RESAMPLES,
) -> None:
    """Chamfer distance after each grasp that a strategy chose among those stored, relative to the first, with 95 %
    bootstrap intervals. The oracle takes the grasp that leaves the least error.
    """
    measured, chosen = tables.selection_errors(selections, experiments, split)
    figure = new_figure(5 * len(experiments) + 1, 4)
    panels = figure.subplots(1, len(experiments), squeeze=False, sharey=True, gridspec_kw=PANEL)[0]
    for axes, (name, setup) in zip(panels, experiments.items(), strict=True):
        of_model = {strategy: keys for (model, strategy), keys in chosen.items() if model == name}
        for colour, (strategy, keys) in zip(COLOURS, of_model.items(), strict=False):
            _line(axes, list(keys), _against_first(measured, keys, resamples), {"color": colour}, strategy)
        title = f"{setup.method.label}, {setup.input_label}"
        _finish(axes, "Chosen grasps", "Chamfer distance against the first", title, percent=True)
    save(figure, path)


@products.figure(rings="extrapolation")
def error_over_rings(
    rings: Frame, experiments: tables.Experiments, path: Path | str, split: str = "test", resamples: int = RESAMPLES
) -> None:
    """Mean squared distance from the true surface to the prediction, in square rings around each touch: this run's,
    with 95 % bootstrap intervals, for occluded and unoccluded vision; and the paper's. Charts without communication are
    copied into the mesh and change nothing else. Each panel has its own scale.
    """
    measured = tables.ring_errors(rings, list(experiments), split)
    published = stated("extrapolation")
    images = list(dict.fromkeys(experiment.vision for experiment in experiments.values()))
    figure = new_figure(4.5 * len(images) + 4.5, 5.2)
    *panels, papers = figure.subplots(1, len(images) + 1, gridspec_kw=PANEL | {"bottom": 0.4, "top": 0.9})
    for name, setup in experiments.items():
        place, inputs = images.index(setup.vision), setup.input_label
        estimates = [measured.estimate([tables.ring_key(name, ring)], resamples=resamples) for ring in RINGS]
        method = setup.method.label if setup.touch else f"vision alone, {setup.method.label}"
        _line(panels[place], RINGS, estimates, _style(setup), method)
        if tables.ring_key(name, RINGS[0]) in published:
            paper = [published[tables.ring_key(name, ring)] for ring in RINGS]
            papers.plot(RINGS, paper, "--o", color=COLOURS[2 * place + setup.touch], lw=1, ms=3.5, label=inputs)
    titles = [f"{image} vision ({_size(measured, split)})" for image in images]
    for axes, title in zip([*panels, papers], [*titles, "The paper"], strict=True):
        _finish(axes, "Ring, in sensor sizes", "Mean squared distance, m²", title)
        axes.set_ylim(bottom=0)
        axes.title.set_y(1.03)
        axes.ticklabel_format(axis="y", style="sci", scilimits=(0, 0), useMathText=True)
        axes.get_legend().set(loc="upper center", bbox_to_anchor=(0.5, -0.15))  # no place inside is free of lines
    save(figure, path)


def _against_first(measured: Errors, keys: Mapping[int, str], resamples: int) -> np.ndarray:
    """Estimates (n, 3) of the relative change of errors against the first of them, and their intervals."""
    first = next(iter(keys.values()))
    pairs = ([key, first] for key in keys.values())
    estimates = [measured.estimate(pair, lambda means: ratio(means) - 1, resamples) for pair in pairs]
    return np.maximum(estimates, -1)  # errors are not negative


def _style(setup: Experiment) -> dict[str, Any]:
    """Colour and dashes of a line: vision alone is dotted."""
    method = setup.method.name
    number = ORDER.index(method) if method in ORDER else list(METHODS).index(method)
    return {"color": COLOURS[number % len(COLOURS)], "linestyle": "-" if setup.touch else ":"}


def _line(axes: Axes, x: Sequence[int], estimates: ArrayLike, style: dict[str, Any], label: str) -> None:
    value, low, high = np.array(estimates).T
    axes.fill_between(x, low, high, color=style["color"], alpha=0.12, lw=0)
    axes.plot(x, value, marker="o", lw=1.6, ms=4, label=label, **style)


def _finish(axes: Axes, x: str, y: str, title: str, percent: bool = False) -> None:
    from matplotlib.ticker import MaxNLocator, PercentFormatter

    axes.set_title(title, fontsize=TITLE)
    axes.set_xlabel(x, fontsize=LABEL)
    axes.set_ylabel(y, fontsize=LABEL)
    axes.tick_params(labelsize=LABEL - 1)
    axes.spines[["top", "right"]].set_visible(False)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    if percent:
        axes.yaxis.set_major_formatter(PercentFormatter(1))
    axes.legend(fontsize=LABEL - 1.5, frameon=False)


def _size(measured: Errors, split: str) -> str:
    seeds = max(len(values) for values in measured.values.values())
    counted = (len(measured.objects), "object"), (seeds, "seed")
    counts = (f"{count} {what}{'s' * (count != 1)}" for count, what in counted)
    return ", ".join([f"{split} split", *counts])
