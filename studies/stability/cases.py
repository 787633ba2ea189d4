"""Stiff and extreme cases: the quantities that each case measures, with bounds and verdicts.

A suite of the stability report is a module with `CASES = Cases()`, to which `@CASES.case("name", "stage")` adds
functions of an object of the run that yield findings.
"""

import logging
import re
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import pandas as pd

log = logging.getLogger(__name__)

COLUMNS = ("suite", "case", "stage", "quantity", "bound", "value", "unit", "verdict", "note", "seconds")
HOLDS, REJECTED, FAILS = "holds", "rejected", "fails"


class Finding(NamedTuple):
    """One quantity of a case. verdict: `holds`, `rejected` (with a clear error, in the note) or `fails`."""

    quantity: str
    bound: str
    value: Any
    unit: str
    verdict: str
    note: str = ""


class Case(NamedTuple):
    """One extreme case. short: whether it takes a second or two only, so that the tests run it, too."""

    name: str
    stage: str
    examine: Callable[[Any], Iterable[Finding]]
    short: bool

    def __str__(self) -> str:
        return self.name


class Cases(list):
    """The cases of one suite, in order."""

    def case(self, name: str, stage: str, short: bool = True) -> Callable[[Callable], Callable]:
        """Decorator: add a function as a case. The function takes a `Subject` and yields findings."""

        def add(function: Callable) -> Callable:
            self.append(Case(name, stage, function, short))
            return function

        return add


def at_most(quantity: str, value: float, bound: float, unit: str = "", note: str = "") -> Finding:
    """A finding that holds if the value is a number and no more than the bound."""
    return Finding(quantity, f"<= {bound:g}", value, unit, HOLDS if value <= bound else FAILS, note)


def at_least(quantity: str, value: float, bound: float, unit: str = "", note: str = "") -> Finding:
    """A finding that holds if the value is a number and no less than the bound."""
    return Finding(quantity, f">= {bound:g}", value, unit, HOLDS if value >= bound else FAILS, note)


def equal(quantity: str, value: Any, expected: Any, unit: str = "", note: str = "") -> Finding:
    """A finding that holds if the value equals the expected one."""
    return Finding(quantity, f"== {expected}", value, unit, HOLDS if value == expected else FAILS, note)


def rejects(quantity: str, function: Callable[[], Any], errors: type[Exception] | tuple, reason: str) -> Finding:
    """A finding that is `rejected` if the function raises one of `errors` with a message that matches `reason`."""
    expected = f"rejected: {reason}"
    try:
        result = function()
    except errors as error:
        matches = re.search(reason, str(error)) is not None
        return Finding(quantity, expected, "rejected", "", REJECTED if matches else FAILS, str(error))
    return Finding(quantity, expected, f"accepted: {result!r:.80}", "", FAILS)


def examine(suite: str, case: Case, subject: Any) -> list[dict[str, Any]]:
    """Rows of one case, with the columns `COLUMNS`: its findings, and the warnings of Python and numpy.

    An error that the case does not expect is a finding that fails.
    """
    log.info("%s: %s", suite, case.name)
    start = time.perf_counter()
    findings: list[Finding] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", RuntimeWarning)
        try:
            findings.extend(case.examine(subject))
            if not findings:
                raise ValueError("the case measures nothing")
        except Exception as error:
            log.exception("%s: %s stopped", suite, case.name)
            where = traceback.extract_tb(error.__traceback__)[-1]
            note = f"{type(error).__name__}: {error} ({where.name}, line {where.lineno})"
            findings.append(Finding("runs to its end", "no error", "error", "", FAILS, note))
    warned = "; ".join(sorted({str(warning.message) for warning in caught if warning.category is RuntimeWarning}))
    if warned:
        findings.append(Finding("numerical warnings", "none", len(caught), "", FAILS, warned))
    seconds = time.perf_counter() - start
    for finding in findings:
        log.info("  %s: %s %s, %s: %s", finding.quantity, finding.value, finding.unit, finding.bound, finding.verdict)
    return [
        {"suite": suite, "case": case.name, "stage": case.stage, **finding._asdict(), "seconds": seconds}
        | {"note": without_folders(finding.note)}
        for finding in findings
    ]


def without_folders(note: str) -> str:
    """Remove the names of temporary folders from a note: they differ from run to run."""
    return re.sub(rf"{re.escape(tempfile.gettempdir())}/[^/\s']+/?", "", note)


def report(suite: str, cases: Iterable[Case], subject: Any) -> pd.DataFrame:
    """All cases of a suite on one object of the run: its rows of `reports/stability.csv`."""
    rows = [row for case in cases for row in examine(suite, case, subject)]
    table = pd.DataFrame(rows, columns=list(COLUMNS))
    for row in table[table["verdict"] == FAILS].itertuples():
        of = f"{suite}, {row.case}: {row.quantity}"
        log.warning("%s is %s, not %s: %s", of, row.value, row.bound, row.note)
    return table
