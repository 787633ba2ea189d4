"""What touch, grasps, copying and communication change: differences of two experiments, with their verdicts.

`paper/effects.csv` has a row a difference: what it shows, the experiment, the one that it is compared with, and the
experiment of the paper whose numbers stand beside (none: the paper states nothing). `docs/evaluation.md` says what a
finding is.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from palpate.experiments import SPLITS
from palpate.results import model_tables as tables
from palpate.results import products
from palpate.results.bootstrap import RESAMPLES
from palpate.results.claims import contrast
from palpate.results.errors import AVERAGE, Errors, errors
from palpate.results.published import effects, paper_values

# The verdict by the sign of a finding, and what stands behind it where a single seed was trained.
VERDICTS = {-1: "better", 0: "undecided", 1: "worse"}
ONE_SEED = " (one seed)"


@products.table(evaluations="effects", splits=("validation", "test"))
def touch_effect(evaluations: pd.DataFrame, resamples: int = RESAMPLES) -> pd.DataFrame:
    """What touch, more grasps, copying and communication change, and the paper's own graph: the Chamfer distance (9000
    times m²) of one experiment less that of another, paired by object and seed, on both splits. `better` and `worse`
    are findings: the interval excludes 0, and two seeds differ by less.

    evaluations: rows of `rows.read`; differences are those whose experiments it has.

    Columns: effect, experiment, compared_with, split, difference (the experiment's average less the other's) with its
    interval, percent (of the other's) with its interval and the paper's, between_seeds (how far two seeds differ in the
    difference), verdict (`better`: the experiment's error is lower), objects, seeds, steps. A difference is a finding
    if its interval excludes 0 and two seeds differ by less. Raises EvaluationError if experiments were measured on
    different objects or with different seeds.
    """
    rows = []
    for row, split, found in _compared(evaluations):
        pair = {"experiment": row["experiment"], "compared_with": row["compared_with"]}
        difference = _difference(found, row, _stated(split, AVERAGE), resamples)
        rows.append({"effect": row["effect"], **pair, "split": split, **difference})
    return _effects_table(rows, evaluations, "A difference is the error of `experiment` less that of `compared with`")


@products.table(evaluations="effects", splits=("validation", "test"))
def touch_effect_by_class(evaluations: pd.DataFrame, resamples: int = RESAMPLES) -> pd.DataFrame:
    """What touch, more grasps, copying and communication change in each class. `error` and `median` (over objects) are
    those of the experiment that is compared with.

    Columns: effect, split, class, error, median, and those of `touch_effect` from difference on.
    """
    rows = []
    for row, split, whole in _compared(evaluations):
        for name in whole.class_names:
            found = whole.of_class(name)
            before = found.values[row["compared_with"]].mean(axis=0)
            known = {"class": name, "error": before.mean(), "median": np.median(before)}
            difference = _difference(found, row, _stated(split, name), resamples)
            rows.append({"effect": row["effect"], "split": split, **known, **difference})
    return _effects_table(
        rows,
        evaluations,
        "`error` and `median` are those of what it is compared with. A difference is between averages of the class",
    )


def _compared(evaluations: pd.DataFrame) -> Iterator[tuple[dict[str, str], str, Errors]]:
    """The differences whose experiments were measured, with each split and its errors."""
    chosen = effects(set(evaluations["experiment"]))
    names = sorted({name for row in chosen for name in (row["experiment"], row["compared_with"])})
    by_split = {split: errors(evaluations, names, split) for split in SPLITS}
    for row in chosen:
        for split, found in by_split.items():
            yield row, split, found


def _difference(found: Errors, row: dict[str, str], stated: dict[str, float], resamples: int) -> dict[str, Any]:
    """The columns of a difference of two experiments' averages, from `difference` on; `stated` has the paper's."""
    pair = row["experiment"], row["compared_with"]
    (difference,) = contrast(1, -1)
    estimate = found.estimate(pair, difference, resamples)
    percent = found.estimate(pair, lambda means: 100 * (means[..., 0] / means[..., 1] - 1), resamples)
    spread = found.between_seeds(pair, difference)
    sizes = tables.size_columns(found, *pair)
    sign = estimate.sign(spread)
    return {
        **tables.interval_columns("difference", estimate),
        **tables.interval_columns("percent", percent),
        "percent_paper": 100 * (stated.get(row["stated_as"], np.nan) / stated.get(pair[1], np.nan) - 1),
        "between_seeds": spread,
        "verdict": VERDICTS[sign] + (ONE_SEED if sign and sizes["seeds"] == 1 else ""),
        **sizes,
    }


def _effects_table(rows: list[dict], evaluations: pd.DataFrame, what: str) -> pd.DataFrame:
    """The table of these rows, which evaluations are compared in; its note begins with `what` a difference is."""
    table = tables.frame_of(rows, evaluations["class"])
    table.attrs["note"] = (
        f"{what}, paired by object and seed. It is a finding (better, worse) if its interval excludes 0 and two seeds "
        f"differ by less (`between seeds`). {tables.intervals_note(int(table['seeds'].max()))}"
    )
    table.attrs |= {"decimals": 3, "exact": {"percent": 1}}
    return table


def _stated(split: str, group: str) -> dict[str, float]:
    """The paper's numbers of its experiments on a split, of a class or the average."""
    stated: dict[str, float] = {}
    for table in ("model_selection",) if split == "validation" else ("grasps", "input_modalities"):
        frame = paper_values(table)
        frame = frame[frame["class"] == group] if "class" in frame else frame[[group == AVERAGE] * len(frame)]
        stated |= dict(zip(frame["experiment"], frame["value"], strict=True))
    return stated
