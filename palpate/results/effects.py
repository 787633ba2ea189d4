"""What touch, grasps, copying and communication change: differences of two experiments, with their verdicts.

`paper/effects.csv` has a row a difference: what it shows, and two `published.Term`. For our methods those in the
place of the paper's are compared (`published.exchanged`). `docs/evaluation.md` says what a finding is.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.experiments import METHODS, SPLITS
from palpate.results import model_tables as tables
from palpate.results import products
from palpate.results.bootstrap import RESAMPLES
from palpate.results.claims import STATISTICS
from palpate.results.errors import AVERAGE, Errors, errors, ratio
from palpate.results.published import effects, stated

if TYPE_CHECKING:
    from pandas import DataFrame as Frame

VERDICTS = {-1: "better", 0: "undecided", 1: "worse"}  # by the sign of a finding


@products.table(evaluations="effects", splits=("validation", "test"))
def touch_effect(evaluations: Frame, resamples: int = RESAMPLES) -> Frame:
    """What touch, more grasps, copying and communication change, in the paper's method and in ours: the Chamfer
    distance (9000 times m²) of one experiment less that of another, paired by object and seed, on both splits. `better`
    and `worse` are findings: the interval excludes 0, and two seeds differ by less. `percent abc`: as published by the
    authors for their models on ABC objects.

    Differences are those whose experiments `evaluations` has. Columns: `difference`, the experiment's average less the
    other's; `percent` of the other's, the paper's and that of ABC objects; `between_seeds`, how far two seeds differ in
    the difference. Raises EvaluationError if experiments were measured on different objects or with different seeds.
    """
    rows, abc = [], stated("abc")
    for row, split, measured in _compared(evaluations):
        difference = _difference(measured, row, _stated(split, AVERAGE), abc, resamples)
        rows.append(row["named"] | {"split": split} | difference)
    return _effects_table(rows, evaluations, "A difference is the error of `experiment` less that of `compared with`")


@products.table(evaluations="effects", splits=("validation", "test"))
def touch_effect_by_class(evaluations: Frame, resamples: int = RESAMPLES) -> Frame:
    """What touch, more grasps, copying and communication change in each class. `error` and its median are those of the
    experiment that is compared with."""
    rows = []
    for row, split, whole in _compared(evaluations):
        for name in whole.class_names:
            measured, other = whole.of_class(name), [row["compared_with"]]
            known = {"class": name, "error": measured.values[other[0]].mean(), "error_median": measured.median(other)}
            difference = _difference(measured, row, _stated(split, name), {}, resamples)
            rows.append(row["named"] | {"split": split, **known, **difference})
    what = "`error` is that of what it is compared with. A difference is between averages of the class"
    return _effects_table(rows, evaluations, what)


def _compared(evaluations: Frame) -> Iterator[tuple[dict[str, Any], str, Errors]]:
    """The differences whose experiments were measured, with each split and its errors; `named`: the columns that say
    what is compared."""
    chosen = effects(set(evaluations["experiment"]))
    names = sorted({name for row in chosen for name in (row["experiment"], row["compared_with"])})
    by_split = {split: errors(evaluations, names, split) for split in SPLITS}
    for row in chosen:
        named = {"effect": row["effect"], "method": METHODS[row["method"]].label}
        named |= {key: row[key] for key in ("experiment", "compared_with")}
        for split, measured in by_split.items():
            yield row | {"named": named}, split, measured


def _difference(
    measured: Errors, row: dict[str, Any], paper: dict[str, float], abc: dict[str, float], resamples: int
) -> dict[str, Any]:
    """The columns from `difference` on; `paper` has the paper's averages, `abc` those of ABC objects."""
    pair = row["experiment"], row["compared_with"]
    (difference,) = STATISTICS["contrast"](1, -1)
    estimate = measured.estimate(pair, difference, resamples)
    percent = measured.estimate(pair, lambda means: 100 * (ratio(means) - 1), resamples)
    spread = measured.between_seeds(pair, difference)
    sizes = tables.size_columns(measured, *pair)
    sign = estimate.sign(spread)
    return {
        **estimate.columns("difference"),
        "difference_median": measured.median(pair, difference),
        **percent.columns("percent"),
        **{f"percent_{name}": _percent(known, row) for name, known in {"paper": paper, "abc": abc}.items()},
        "between_seeds": spread,
        "verdict": VERDICTS[sign] + (" (one seed)" if sign and sizes["seeds"] == 1 else ""),
        **sizes,
    }


def _percent(published: Mapping[str, float], row: dict[str, Any]) -> float:
    """A difference in percent by published numbers; nan where one is missing."""
    one, other = row["stated"]
    return 100 * (published.get(one, np.nan) / published.get(other, np.nan) - 1)


def _effects_table(rows: list[dict], evaluations: Frame, what: str) -> Frame:
    """The table of these rows, which evaluations are compared in; its note begins with `what` a difference is."""
    table = tables.frame_of(rows, evaluations["class"])
    if table["percent_abc"].isna().all():
        del table["percent_abc"]
    table.attrs["note"] = (
        f"{what}, paired by object and seed. It is a finding (better, worse) if its interval excludes 0 and two seeds "
        f"differ by less (`between seeds`). {tables.intervals_note(int(table['seeds'].max()))}{tables.MEDIANS_NOTE}"
    )
    table.attrs |= {"decimals": 3, "exact": {"percent": 1, "percent_abc": 1}}
    return table


def _stated(split: str, group: str) -> dict[str, float]:
    """The paper's numbers of its experiments on a split, of a class or the average."""
    named = ("model_selection",) if split == "validation" else ("grasps", "input_modalities")
    return {name: value for table in named for name, value in stated(table, group).items()}
