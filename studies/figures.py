"""The reports' figures: fronts of error and time, margins of extreme cases, savings of omissions."""

import re
from itertools import cycle
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import FormatStrFormatter, LogLocator, NullFormatter

from palpate.results.page import COLOURS, FAINT, INK, LABEL, PALE, TITLE, new_figure, save, styled
from studies.error_vs_runtime.study import over_objects, setting
from studies.omitted.omission import OMITTED, SAME, verdict_text
from studies.stability.cases import FAILS, HOLDS, REJECTED

VERDICT_COLOURS = {HOLDS: COLOURS[2], REJECTED: COLOURS[0], FAILS: COLOURS[1]}
PANELS_PER_ROW = 3
PANEL = (4.2, 3.0)  # inches
LABEL_DISTANCE = 0.1  # of a panel: of points nearer than this only one has a label
WIDE_RANGE = 300.0  # an axis that spans more than this ratio shows powers of ten only


@styled
def fronts(table: pd.DataFrame, path: Path | str) -> None:
    """Error against seconds, means over objects; a panel for each drawn measure of a stage.

    The line is the front, whose methods are labelled by their knobs. Rings mark the config's methods. A hollow mark
    is a method on the front whose time does not differ significantly from a neighbour's.
    """
    panels = [rows for _, rows in over_objects(table[table["drawn"]]).groupby(["stage", "measure"], sort=False)]
    columns = min(PANELS_PER_ROW, len(panels))
    lines = -(-len(panels) // columns)
    figure = new_figure(columns * PANEL[0] + 0.35, lines * PANEL[1] + 0.35)
    grid = figure.subplots(lines, columns, squeeze=False)
    for axes, rows in zip(grid.flat, panels, strict=False):
        _front(axes, rows[rows["error"].notna()])
    for axes in grid.flat[len(panels) :]:
        axes.set_axis_off()
    figure.tight_layout(rect=(0, 0, 1, 1 - 0.25 / figure.get_figheight()))
    legend = "line: front    ring: the config's    hollow: not ranked, too noisy"
    figure.text(0.5, 1 - 0.18 / figure.get_figheight(), legend, ha="center", fontsize=LABEL, color=FAINT)
    save(figure, path)


def _front(axes: Axes, rows: pd.DataFrame) -> None:
    seconds, errors = (rows[key].to_numpy(dtype=float) for key in ("seconds", "error"))
    least = errors[errors > 0].min(initial=np.inf) / 3
    shown = np.where(errors == 0, least if np.isfinite(least) else 1.0, errors)  # also where an error of 0 is drawn
    spread = np.abs(rows[["seconds_low", "seconds_high"]].to_numpy(dtype=float).T - seconds)
    on, noisy, chosen = (rows[key].to_numpy(dtype=bool) for key in ("front", "noisy", "chosen"))
    for colour, method in zip(cycle(COLOURS), dict.fromkeys(rows["method"]), strict=False):
        own = (rows["method"] == method).to_numpy()
        axes.errorbar(seconds[own], shown[own], xerr=spread[:, own], fmt="none", ecolor=colour, lw=0.7, alpha=0.5)
        axes.scatter(seconds[own], shown[own], s=14, color=colour, label=method)
        axes.scatter(seconds[own & noisy], shown[own & noisy], s=6, color="white", zorder=3)
    order = np.flatnonzero(on)[np.argsort(seconds[on])]
    axes.plot(seconds[order], shown[order], color=PALE, lw=1, zorder=0)
    axes.scatter(seconds[chosen], shown[chosen], s=70, facecolor="none", edgecolor=INK, lw=1, zorder=4)
    # Of labels too near to another, or to a ring, only the first is drawn.
    logs = np.log(np.stack([seconds, shown], axis=1))
    place = logs / np.where(np.ptp(logs, axis=0) > 0, np.ptp(logs, axis=0), 1)
    placed = list(np.flatnonzero(chosen))
    for point in (k for k in order if not chosen[k]):
        if all(np.linalg.norm(place[point] - place[other]) > LABEL_DISTANCE for other in placed):
            placed.append(point)
            name, at = setting(*rows[["knob", "value"]].iloc[point]), (seconds[point], shown[point])
            # Nothing lies left of a point on the front and below it.
            away = {"xytext": (-3, -2), "textcoords": "offset points", "ha": "right", "va": "top"}
            axes.annotate(name, at, fontsize=LABEL - 4, **away)
    axes.margins(0.2, 0.1)
    for name, axis, drawn in (("x", axes.xaxis, seconds), ("y", axes.yaxis, shown)):
        axes.set(**{f"{name}scale": "log"})
        powers_of_ten_only = np.nanmax(drawn) > WIDE_RANGE * np.nanmin(drawn)
        axis.set_major_locator(LogLocator(subs=(1,) if powers_of_ten_only else (1, 2, 5), numticks=8))
        axis.set_major_formatter(FormatStrFormatter("%g"))
        axis.set_minor_formatter(NullFormatter())
    first, zero = rows.iloc[0], ", lowest: 0" if (errors == 0).any() else ""
    axes.set_title(first["stage"].replace("_", " "), fontsize=TITLE)
    axes.set_xlabel("seconds", fontsize=LABEL - 1)
    axes.set_ylabel(f"{first['measure']}, {first['unit']}{zero}", fontsize=LABEL - 1)
    axes.tick_params(labelsize=LABEL - 2, which="both")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(fontsize=LABEL - 3, frameon=False)


@styled
def margins(table: pd.DataFrame, path: Path | str) -> None:
    """A line for each case: findings relative to their bounds, coloured by verdict; those left of 1 hold."""
    cases = list(table.groupby(["suite", "case"], sort=False))
    height = 0.17 * len(cases) + 1.0
    figure = new_figure(9, height)
    axes = figure.add_axes((0.47, 0.5 / height, 0.5, 1 - 1.0 / height))
    left = {"transform": axes.get_yaxis_transform(), "ha": "right", "va": "center", "fontsize": LABEL - 2}
    before = cases[0][0][0]
    for place, ((suite, case), findings) in enumerate(cases):
        axes.axhline(-place, color=PALE, lw=0.3, zorder=0)
        colours = findings["verdict"].map(VERDICT_COLOURS)
        ratios = findings.apply(_margin, axis=1)
        axes.scatter(ratios, [-place] * len(ratios), s=12, c=colours, alpha=0.7, linewidths=0)
        axes.text(-0.01, -place, case, **left)
        if suite != before:
            axes.axhline(0.5 - place, color=INK, lw=0.6)
        before = suite
    axes.axvline(1, color=INK, lw=0.8)
    axes.set(xscale="log", yticks=[], ylim=(-len(cases), 1))
    axes.set_xlabel("value / bound (at the left end: 0, or no number)", fontsize=LABEL)
    axes.tick_params(labelsize=LABEL - 1)
    axes.spines[["top", "right", "left"]].set_visible(False)
    counts = table["verdict"].value_counts()
    for place, (verdict, colour) in enumerate(VERDICT_COLOURS.items()):
        style = {"x": 0.5 + 0.14 * place, "y": 1 - 0.3 / height, "color": colour, "fontsize": TITLE}
        figure.text(s=f"{counts.get(verdict, 0)} {verdict}", **style)
    save(figure, path)


def _margin(row: pd.Series, least: float = 1e-6) -> float:
    """A finding's value relative to its bound, below 1 where it holds; `least` if there is no such number."""
    match = re.fullmatch(r"(<=|>=) (\S+)", str(row["bound"]))
    try:
        value = float(row["value"])
    except ValueError:
        return least
    if not match or not np.isfinite(value):
        return least if row["verdict"] != FAILS else 1 / least
    part, whole = (value, float(match[2])) if match[1] == "<=" else (float(match[2]), value)
    return float(np.clip(part / whole if whole else float(part > 0), least, 1 / least))


@styled
def savings(table: pd.DataFrame, path: Path | str) -> None:
    """Seconds and bytes without each item, relative to those with it; totals over objects."""
    totals = dict.fromkeys(("seconds_with", "seconds_without", "bytes_with", "bytes_without"), "sum")
    rows = table.groupby(["stage", "item"], sort=False).agg(
        totals | {"noisy": "all", "state": "first", "verdict": lambda verdicts: set(verdicts) == {SAME}}
    )
    height = 0.26 * len(rows) + 1.0
    figure = new_figure(9, height)
    axes = figure.add_axes((0.42, 0.5 / height, 0.4, 1 - 0.8 / height))
    text = {"va": "center", "fontsize": LABEL - 1, "transform": axes.get_yaxis_transform()}
    for place, ((stage, item), row) in enumerate(rows.iterrows()):
        colour, alpha = COLOURS[0] if row["state"] == OMITTED else FAINT, 0.35 if row["noisy"] else 0.9
        axes.barh(-place, row["seconds_without"] / row["seconds_with"], height=0.55, color=colour, alpha=alpha)
        if row["bytes_with"]:
            axes.plot(row["bytes_without"] / row["bytes_with"], -place, "D", ms=4, color=COLOURS[1])
        axes.text(-0.02, -place, f"{stage}: {item}", ha="right", **text)
        verdict = verdict_text(row["verdict"], row["state"])
        axes.text(1.02, -place, verdict, ha="left", color=INK if row["verdict"] else COLOURS[1], **text)
    axes.axvline(1, color=INK, lw=0.8)
    axes.set(yticks=[], ylim=(-len(rows) + 0.3, 0.7), xlim=(0, 1.15))
    label = "without / with: seconds (bars; pale: within the noise), bytes (diamonds)"
    axes.set_xlabel(label, fontsize=LABEL)
    axes.tick_params(labelsize=LABEL - 1)
    axes.spines[["top", "right"]].set_visible(False)
    save(figure, path)
