"""The paper's claims that a number can decide, and a run's verdict on each; and what touch, grasps, copying and
communication change: differences of two experiments. Of the paper's method and of ours.

`paper/claims.csv` has a row a claim: the sentence, and where the paper makes it; the `group` of claims that say the
same of several set-ups; the split and the table whose experiments decide it; `experiments`, whose averages the
statistic takes, in order, with "; " between (`published.Term`; of our methods those in their place:
`published.exchanged`); and the statistic, a name in `STATISTICS` with its numbers, which must be negative. The claim
holds if the whole 95 % interval is below zero, does not if all of it is above, and is undecided otherwise; it is
undecided too if two seeds differ by more than the number. Bounds of a statistic must be negative instead, all of them.

Two limits come from the paper's own numbers. "Approximately the same loss at every plane size" (section 5.3) is
`change 0.3`: the paper's vision-only errors change by -28 % and -15 % from ring 1 to ring 5. "Practically perfect, when
compared to the error incurred over full surfaces" is `share_of_least 0.05`: the paper's share is 1.2 %.

`paper/effects.csv` has a row a difference: what it shows, and two terms. `docs/evaluation.md` says what a finding is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.experiments import METHODS, SPLITS
from palpate.results import model_tables as tables
from palpate.results import products
from palpate.results.bootstrap import RESAMPLES, Estimate, Statistic, ratio
from palpate.results.errors import AVERAGE, Errors, errors
from palpate.results.published import claims, effects, paper_values, stated

if TYPE_CHECKING:
    from pandas import DataFrame as Frame

HOLDS, FAILS, UNDECIDED = "holds", "does not hold", "undecided"
EFFECTS = {-1: "better", 0: "undecided", 1: "worse"}  # by the sign of a finding


def _slope(means: np.ndarray) -> np.ndarray:
    steps = np.arange(means.shape[-1]) - (means.shape[-1] - 1) / 2
    return means @ (steps / np.sum(steps**2))


# Each gives the number that is reported. It must be negative; where bounds follow, these must be instead.
STATISTICS: dict[str, Callable[..., list[Statistic]]] = {
    # The weighted sum of averages; `1 -1` is the first's error less the second's.
    "contrast": lambda *weights: [lambda means: means @ np.array(weights)],
    # Change of the error with each further experiment (least squares).
    "slope": lambda: [_slope],
    # The greatest average but for the last, less the last.
    "excess_over_last": lambda: [lambda means: means[..., :-1].max(axis=-1) - means[..., -1]],
    # Relative change from the first to the second, which must be within the limit on either side.
    "change": lambda limit: [
        lambda means: means[..., 1] / means[..., 0] - 1,
        lambda means: means[..., 1] - (1 + limit) * means[..., 0],
        lambda means: (1 - limit) * means[..., 0] - means[..., 1],
    ],
    # The first average over the least of the others, which must be below the limit.
    "share_of_least": lambda limit: [
        lambda means: means[..., 0] / means[..., 1:].min(axis=-1),
        lambda means: means[..., 0] - limit * means[..., 1:].min(axis=-1),
    ],
}


@products.table(name="claims", evaluations="claims", rings="claims", files=("touches",), splits=("validation", "test"))
def decide(evaluations: Frame, rings: Frame, touches: Frame, resamples: int = RESAMPLES) -> Frame:
    """Each claim of the paper that a number can decide, for the paper's method and for ours. A claim is that the
    measured number is negative (or within the bound that it names). It `holds` if this is true of the whole 95 %
    interval, `does not hold` if of no part of it, and is `undecided` otherwise. Differences are taken object by object.

    evaluations: rows of `rows.read` of `published.claimed_experiments`; rings: of those of `extrapolation`. Columns:
    those of `paper/claims.csv`; `measured`, and the same of the paper's numbers (`_paper`); `between_seeds`, how far
    two seeds differ in it; `verdict`; `paper_agrees`, whether the paper's numbers are so (it states no spread). Raises
    EvaluationError if one of the paper's experiments is missing.
    """
    decided = claims({*evaluations["experiment"]})
    measured_by = _errors_by_table(decided, evaluations, rings, touches)
    rows = []
    for claim in decided:
        measured, names = measured_by[claim["table"]], [term.key for term in claim["terms"]]
        statistics, means = STATISTICS[claim["statistic"]](*map(float, claim["parameters"].split())), _stated(claim)
        found = [(measured.estimate(names, one, resamples), measured.between_seeds(names, one)) for one in statistics]
        estimate, spread = found[0]
        rows.append(
            {
                "method": METHODS[claim["method"]].label,
                **{name: claim[name] for name in ("group", "claim", "section", "split")},
                **estimate.columns("measured"),
                "measured_paper": float(statistics[0](means)),
                "between_seeds": spread,
                "unit": claim["unit"],
                "verdict": verdict(found[1:] or found),
                "paper_agrees": "yes" if all(bound(means) < 0 for bound in statistics[1:] or statistics) else "no",
                **tables.size_columns(measured, *names),
            }
        )
    table = tables.frame_of(rows, evaluations["class"])
    agrees = " `paper agrees`: whether the paper's own numbers, without an interval, say so."
    papers = agrees * ("paper_agrees" in table)
    counted = ""
    for method, members in table.groupby("method", sort=False):
        holds, fails, undecided = (int((members["verdict"] == name).sum()) for name in (HOLDS, FAILS, UNDECIDED))
        whole = (members["verdict"] == HOLDS).groupby(members["group"]).all()
        counted += (
            f"{method}: {holds} of {len(members)} claims hold, {fails} do not, {undecided} are "
            f"undecided by this run; {whole.sum()} of {len(whole)} groups hold. "
        )
    table.attrs["note"] = (
        f"{counted}A claim is that a number is negative (where "
        "it names a bound: within it); it holds or not if the whole interval says so, and two seeds differ by less "
        f"(`between seeds`). Differences are paired by object and seed.{papers}{tables.COMMUNICATION_NOTE} "
        f"{tables.intervals_note(int(table['seeds'].max()))}"
    )
    table.attrs["decimals"] = None
    return table


def verdict(bounds: list[tuple[Estimate, float]]) -> str:
    """Of numbers that must all be negative, each with how far two seeds differ in it (see `Estimate.sign`)."""
    signs = [estimate.sign(spread) for estimate, spread in bounds]
    if 1 in signs:
        return FAILS
    return HOLDS if all(sign == -1 for sign in signs) else UNDECIDED


def _errors_by_table(decided: list[dict], evaluations: Frame, rings: Frame, touches: Frame) -> dict[str, Errors]:
    """The errors that the claims of each table are decided by."""
    split = {claim["table"]: claim["split"] for claim in decided}
    names: dict[str, dict[str, None]] = {table: {} for table in split}  # as ordered sets
    for claim in decided:
        names[claim["table"]] |= dict.fromkeys(term.experiment for term in claim["terms"])
    whole = ("model_selection", "input_modalities", "grasps")
    by_table = {table: errors(evaluations, list(names[table]), split[table]) for table in whole}
    by_table["extrapolation"] = tables.ring_errors(rings, list(names["extrapolation"]), "test")
    # On the objects that have both: one without a successful touch has no local error.
    shapes, local = by_table["input_modalities"], tables.touch_errors(touches, "test")
    both = shapes.select(np.isin(shapes.objects, local.objects))
    values = both.values | local.select(np.isin(local.objects, shapes.objects)).values
    by_table["local_touch_charts"] = both._replace(values=values, steps=shapes.steps | local.steps)
    return by_table


def _stated(claim: dict[str, Any]) -> np.ndarray:
    """The paper's averages of what a claim names."""
    table = "input_modalities" if claim["table"] == "local_touch_charts" else claim["table"]
    local = paper_values("local_touch_charts").set_index("class")["value"]
    known = stated(table) | {"cloud": local[AVERAGE]}
    return np.array([known[term.key] for term in claim["stated"]])


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
    rows = [
        named | _difference(measured, named, stated_as, AVERAGE, resamples)
        for named, stated_as, measured in _compared(evaluations)
    ]
    return _effects_table(rows, evaluations, "A difference is the error of `experiment` less that of `compared with`")


@products.table(evaluations="effects", splits=("validation", "test"))
def touch_effect_by_class(evaluations: Frame, resamples: int = RESAMPLES) -> Frame:
    """What touch, more grasps, copying and communication change in each class. `error` and its median are those of the
    experiment that is compared with."""
    rows = []
    for named, stated_as, whole in _compared(evaluations):
        for name in whole.class_names:
            measured, other = whole.of_class(name), [named["compared_with"]]
            known = {"class": name, "error": measured.values[other[0]].mean(), "error_median": measured.median(other)}
            rows.append(named | known | _difference(measured, named, stated_as, name, resamples))
    what = "`error` is that of what it is compared with. A difference is between averages of the class"
    return _effects_table(rows, evaluations, what)


def _compared(evaluations: Frame) -> Iterator[tuple[dict[str, str], list[str], Errors]]:
    """Of each difference that was measured, on each split: the columns that say what it is, the paper's two experiments
    that it is stated as, and the errors on that split."""
    chosen = effects(set(evaluations["experiment"]))
    names = sorted({name for row in chosen for name in (row["experiment"], row["compared_with"])})
    by_split = {split: errors(evaluations, names, split) for split in SPLITS}
    for row in chosen:
        named = {"effect": row["effect"], "method": METHODS[row["method"]].label}
        named |= {key: row[key] for key in ("experiment", "compared_with")}
        for split, measured in by_split.items():
            yield named | {"split": split}, row["stated"], measured


def _difference(
    measured: Errors, named: dict[str, str], stated_as: Sequence[str], group: str, resamples: int
) -> dict[str, Any]:
    """The columns from `difference` on. named, stated_as: as `_compared` gives them; group: a class, or `AVERAGE`."""
    pair = named["experiment"], named["compared_with"]
    (difference,) = STATISTICS["contrast"](1, -1)
    estimate = measured.estimate(pair, difference, resamples)
    percent = measured.estimate(pair, lambda means: 100 * (ratio(means) - 1), resamples)
    spread = measured.between_seeds(pair, difference)
    sizes, sign = tables.size_columns(measured, *pair), estimate.sign(spread)
    of_split = ("model_selection",) if named["split"] == "validation" else ("grasps", "input_modalities")
    papers = {name: value for table in of_split for name, value in stated(table, group).items()}

    def change(published: dict[str, float]) -> float:
        one, other = (published.get(name, np.nan) for name in stated_as)
        return 100 * (one / other - 1)

    return {
        **estimate.columns("difference"),
        "difference_median": measured.median(pair, difference),
        **percent.columns("percent"),
        "percent_paper": change(papers),
        "percent_abc": change(stated("abc", group)),
        "between_seeds": spread,
        "verdict": EFFECTS[sign] + (" (one seed)" if sign and sizes["seeds"] == 1 else ""),
        **sizes,
    }


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
