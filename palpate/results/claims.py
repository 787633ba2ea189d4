"""The paper's claims that a number can decide, and a run's verdict on each, for the paper's method and for ours.

`paper/claims.csv` has a row a claim. Its statistic is a number of averages that must be negative: a difference
of errors, a slope, an error less what is allowed. The claim holds if the whole 95 % interval is below zero, does
not if all of it is above, and is undecided otherwise; it is undecided too if two seeds differ by more than the number.
Where a statistic has bounds, these must be negative instead, all of them.

Columns of the file:
    group                    claims that say the same of several set-ups
    claim, section           the sentence, and where the paper makes it
    split, table             what decides it: a split, and the table whose experiments it compares
    experiments              whose averages the statistic takes, in order, with "; " between: `published.Term`
    statistic, parameters    a name in `STATISTICS`, and its numbers with a space between
    unit                     of the number that is reported

For our methods the experiments that take the place of the paper's are compared (`published.exchanged`), if all were
measured. Two limits come from the paper's own numbers. "Approximately the same loss at every plane size" (section
5.3) is `change 0.3`: the paper's vision-only errors change by -28 % and -15 % from ring 1 to ring 5. "Practically
perfect, when compared to the error incurred over full surfaces" is `share_of_least 0.05`: the paper's share is 1.2 %.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from palpate.methods import METHODS
from palpate.results import model_tables as tables
from palpate.results import products, published
from palpate.results.bootstrap import RESAMPLES, Estimate, Statistic
from palpate.results.errors import AVERAGE, Errors, errors
from palpate.results.published import Term, paper_values, stated

if TYPE_CHECKING:
    from pandas import DataFrame as Frame

HOLDS, FAILS, UNDECIDED = "holds", "does not hold", "undecided"


def contrast(*weights: float) -> list[Statistic]:
    """The weighted sum of averages; `1 -1` is the first's error less the second's."""
    return [lambda means: means @ np.array(weights)]


def slope() -> list[Statistic]:
    """Change of the error with each further experiment (least squares)."""

    def fitted(means: np.ndarray) -> np.ndarray:
        steps = np.arange(means.shape[-1]) - (means.shape[-1] - 1) / 2
        return means @ (steps / np.sum(steps**2))

    return [fitted]


def excess_over_last() -> list[Statistic]:
    """The greatest average but for the last, less the last."""
    return [lambda means: means[..., :-1].max(axis=-1) - means[..., -1]]


def change(limit: float) -> list[Statistic]:
    """Relative change from the first to the second, which must be within the limit on either side."""
    return [
        lambda means: means[..., 1] / means[..., 0] - 1,
        lambda means: means[..., 1] - (1 + limit) * means[..., 0],
        lambda means: (1 - limit) * means[..., 0] - means[..., 1],
    ]


def share_of_least(limit: float) -> list[Statistic]:
    """The first average over the least of the others, which must be below the limit."""
    return [
        lambda means: means[..., 0] / means[..., 1:].min(axis=-1),
        lambda means: means[..., 0] - limit * means[..., 1:].min(axis=-1),
    ]


# Each gives the number that is reported, then the bounds, if it is not that number which must be negative.
STATISTICS: dict[str, Callable[..., list[Statistic]]] = {
    "contrast": contrast,
    "slope": slope,
    "excess_over_last": excess_over_last,
    "change": change,
    "share_of_least": share_of_least,
}


class Claim(NamedTuple):
    """A row of `paper/claims.csv` for one method; `bounds` must be negative for the claim to hold.

    terms: what is compared. stated: the paper's in their place.
    """

    method: str
    group: str
    claim: str
    section: str
    split: str
    table: str
    terms: Sequence[Term]
    stated: Sequence[Term]
    measured: Statistic
    bounds: list[Statistic]
    unit: str

    @property
    def experiments(self) -> list[str]:
        """What the errors of its terms are called."""
        return [term.key for term in self.terms]


def claims(known: Collection[str] = ()) -> list[Claim]:
    """The claims for the paper's method, and for ours if its experiments are known, in the file's order.

    Raises KeyError for a statistic that does not exist.
    """
    decidable = []
    for row in published.claims(known):
        measured, *bounds = STATISTICS[row["statistic"]](*map(float, row["parameters"].split()))
        kept = {name: row[name] for name in Claim._fields if name in row}
        decidable.append(Claim(**kept, measured=measured, bounds=bounds or [measured]))
    return decidable


@products.table(name="claims", evaluations="claims", rings="claims", files=("touches",), splits=("validation", "test"))
def decide(evaluations: Frame, rings: Frame, touches: Frame, resamples: int = RESAMPLES) -> Frame:
    """Each claim of the paper that a number can decide, for the paper's method and for ours. A claim is that the
    measured number is negative (or within the bound that it names). It `holds` if this is true of the whole 95 %
    interval, `does not hold` if of no part of it, and is `undecided` otherwise. Differences are taken object by object.

    evaluations: rows of `rows.read` of `published.claimed_experiments`; rings: of those of `extrapolation`; touches: of
    `evaluations/touch_depth.csv`.

    Columns: method, group, claim, section, split, measured with its interval (`_low`, `_high`) and the same of the
    paper's numbers (`_paper`), between_seeds (how far two seeds differ in it), unit, verdict, paper_agrees (whether the
    paper's numbers themselves are so: it states no spread), objects, seeds, steps. Raises EvaluationError if one of the
    paper's experiments is missing.
    """
    decided = claims({*evaluations["experiment"]})
    measured_by = _errors_by_table(decided, evaluations, rings, touches)
    rows = []
    for claim in decided:
        measured = measured_by[claim.table]
        estimate = measured.estimate(claim.experiments, claim.measured, resamples)
        bounds = [
            (measured.estimate(claim.experiments, bound, resamples), measured.between_seeds(claim.experiments, bound))
            for bound in claim.bounds
        ]
        means = _stated(claim)
        rows.append(
            {
                "method": METHODS[claim.method].label,
                **{name: getattr(claim, name) for name in ("group", "claim", "section", "split")},
                **estimate.columns("measured"),
                "measured_paper": float(claim.measured(means)),
                "between_seeds": measured.between_seeds(claim.experiments, claim.measured),
                "unit": claim.unit,
                "verdict": verdict(bounds),
                "paper_agrees": "yes" if all(bound(means) < 0 for bound in claim.bounds) else "no",
                **tables.size_columns(measured, *claim.experiments),
            }
        )
    table = tables.frame_of(rows, evaluations["class"])
    agrees = " `paper agrees`: whether the paper's own numbers, without an interval, say so."
    papers = agrees if "paper_agrees" in table else ""
    table.attrs["note"] = (
        f"{_counted(table)} A claim is that a number is negative (where "
        "it names a bound: within it); it holds or not if the whole interval says so, and two seeds differ by less "
        f"(`between seeds`). Differences are paired by object and seed.{papers}{tables.COMMUNICATION_NOTE} "
        f"{tables.intervals_note(int(table['seeds'].max()))}"
    )
    table.attrs["decimals"] = None
    return table


def _counted(table: Frame) -> str:
    """How many claims and groups of claims hold, of each method."""
    sentences = []
    for method, members in table.groupby("method", sort=False):
        counts = {name: int((members["verdict"] == name).sum()) for name in (HOLDS, FAILS, UNDECIDED)}
        whole = (members["verdict"] == HOLDS).groupby(members["group"]).all()
        sentences.append(
            f"{method}: {counts[HOLDS]} of {len(members)} claims hold, {counts[FAILS]} do not, {counts[UNDECIDED]} are "
            f"undecided by this run; {whole.sum()} of {len(whole)} groups hold."
        )
    return " ".join(sentences)


def verdict(bounds: list[tuple[Estimate, float]]) -> str:
    """Of numbers that must all be negative, each with how far two seeds differ in it (see `Estimate.sign`)."""
    signs = [estimate.sign(spread) for estimate, spread in bounds]
    if 1 in signs:
        return FAILS
    return HOLDS if all(sign == -1 for sign in signs) else UNDECIDED


def _errors_by_table(decided: list[Claim], evaluations: Frame, rings: Frame, touches: Frame) -> dict[str, Errors]:
    """The errors that the claims of each table are decided by."""

    def experiments(table: str) -> list[str]:
        return list(dict.fromkeys(term.experiment for claim in decided if claim.table == table for term in claim.terms))

    split = {claim.table: claim.split for claim in decided}
    names = ("model_selection", "input_modalities", "grasps")
    by_table = {name: errors(evaluations, experiments(name), split[name]) for name in names}
    by_table["extrapolation"] = tables.ring_errors(rings, experiments("extrapolation"), "test")
    by_table["local_touch_charts"] = _merge(by_table["input_modalities"], tables.touch_errors(touches, "test"))
    return by_table


def _merge(whole: Errors, local: Errors) -> Errors:
    """Errors of both on the objects that both have (one without a successful touch has no local error)."""
    both = whole.select(np.isin(whole.objects, local.objects))
    values = both.values | local.select(np.isin(local.objects, whole.objects)).values
    return both._replace(values=values, steps=whole.steps | local.steps)


def _stated(claim: Claim) -> np.ndarray:
    """The paper's averages of what a claim names."""
    table = "input_modalities" if claim.table == "local_touch_charts" else claim.table
    local = paper_values("local_touch_charts").set_index("class")["value"]
    known = stated(table) | {"cloud": local[AVERAGE]}
    return np.array([known[term.key] for term in claim.stated])
