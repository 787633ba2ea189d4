"""An omission: what a stage does not compute, what that saves, and by how much the result differs."""

import logging
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import pandas as pd

from studies.timing import ROUNDS, differs_significantly, interleaved

log = logging.getLogger(__name__)

COLUMNS = (
    *("stage", "item", "when", "omitted", "state", "object", "seconds_with", "seconds_without", "seconds_saved"),
    *("bytes_with", "bytes_without", "bytes_saved", "difference", "unit", "bound", "verdict", "noisy"),
)
SAME, DIFFERS = "same", "differs"
OMITTED, STAYS, NOT_MODELLED = "omitted", "stays", "not modelled"


class Omission(NamedTuple):
    """One item of a stage's work, with it and without it.

    stage: name of the stage; item: the work that could be omitted. when: the cases in which it is, as text. with_it,
    without: make the result with the item and without it, all else equal. difference: the largest between the two
    results, in `unit`; bound: of it, 0 for bit-equal results. size: bytes of a result, where the omission saves any.
    state: `OMITTED`: the result without it is the same. `STAYS`: omitting it would change the result or save nothing.
    `NOT_MODELLED`: a choice of the model, not a saving; with the item the result is different.
    """

    stage: str
    item: str
    when: str
    object: str
    with_it: Callable[[], Any]
    without: Callable[[], Any]
    difference: Callable[[Any, Any], float]
    unit: str
    bound: float = 0.0
    size: Callable[[Any], float] | None = None
    state: str = OMITTED


def compare(omission: Omission, rounds: int = ROUNDS) -> dict[str, Any]:
    """A row of `reports/omitted.csv` with the columns `COLUMNS`; both variants are timed alternately.

    Logs a warning if an omitted item changes the result. `noisy`: the two times don't differ significantly.
    """
    without_times = results(omission)
    times = interleaved({"with": omission.with_it, "without": omission.without}, rounds, warm=True)
    row = without_times | {
        "seconds_with": times["with"].seconds,
        "seconds_without": times["without"].seconds,
        "seconds_saved": times["with"].seconds - times["without"].seconds,
        "noisy": not differs_significantly(times["with"], times["without"]),
    }
    log.info("%s without %s: %s", omission.stage, omission.item, row)
    if row["omitted"] and row["verdict"] == DIFFERS:
        what = f"{omission.stage}, {omission.object}: omitting {omission.item} changes the result"
        log.warning("%s by %g %s, more than %g", what, row["difference"], omission.unit, omission.bound)
    return row


def results(omission: Omission) -> dict[str, Any]:
    """The columns of a row but for times; makes each result once.

    `verdict` is `same` if the difference is within the bound, else `differs`.
    """
    full, reduced = omission.with_it(), omission.without()
    difference = float(omission.difference(full, reduced))
    size = (omission.size(full), omission.size(reduced)) if omission.size else (float("nan"),) * 2
    return {
        **{key: getattr(omission, key) for key in ("stage", "item", "when", "state", "object", "unit", "bound")},
        "omitted": omission.state == OMITTED,
        "bytes_with": size[0],
        "bytes_without": size[1],
        "bytes_saved": size[0] - size[1],
        "difference": difference,
        "verdict": SAME if difference <= omission.bound else DIFFERS,
    }


def verdict_text(same: bool, state: str) -> str:
    """The verdict as text, with the state of an item that is not omitted."""
    verdict = SAME if same else DIFFERS
    return verdict if state == OMITTED else f"{verdict}, {state}"


def report(omissions: Iterable[Omission], rounds: int = ROUNDS) -> pd.DataFrame:
    """The rows of one item of `reports/omitted.csv`."""
    return pd.DataFrame([compare(omission, rounds) for omission in omissions], columns=list(COLUMNS))
