"""Error against run time of the methods of one stage, object by object.

A study says what its methods are, on what they work, and how wrong a result is; `measure` runs them and makes
the rows of `reports/error_vs_runtime.csv`.
"""

import logging
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from studies.error_vs_runtime.front import front
from studies.timing import ROUNDS, Timing, differs_significantly, interleaved, timing, with_peak_memory

log = logging.getLogger(__name__)

COLUMNS = (
    "stage", "object", "method", "knob", "value", "chosen", "measure", "drawn", "error", "unit", "reference",
    "seconds", "seconds_low", "seconds_high", "rounds", "peak_mib", "front", "noisy",
)  # fmt: skip
ALL = "all"  # the object of rows that stand for all objects together


class Method(NamedTuple):
    """One way to do it: a method with one knob at one value.

    run: from a case to a result; the same every time. chosen: whether the run's config has it.
    """

    name: str
    knob: str
    value: Any
    run: Callable[[Any], Any]
    chosen: bool = False

    def __str__(self) -> str:
        return f"{self.name}, {self.knob} {self.value}"


class Study(ABC):
    """What is compared in a stage.

    Attributes:
        stage: its name in the report.
        units: the measures of error and their units.
        panels: how many of them, from the first, the figure draws.
        reference: what errors are against, in words.
    """

    stage: str
    units: Mapping[str, str]
    reference: str
    panels: int = 1

    @abstractmethod
    def cases(self) -> Iterable[tuple[str, Any]]:
        """Names of objects, and what methods are given."""

    @abstractmethod
    def methods(self) -> list[Method]:
        """All that are compared."""

    @abstractmethod
    def errors(self, case: Any, result: Any) -> dict[str, float]:
        """How wrong a result is: a number for each key of `units`; NaN where it makes no sense."""


def measure(study: Study, rounds: int = ROUNDS) -> pd.DataFrame:
    """Every method on every case: a row a case, method and measure, with the columns `COLUMNS`.

    Seconds are the median of the rounds and their quartiles (`studies.timing`); the peak memory is what
    the process takes more at the method's first run. `front`: nothing else of the same object is faster and
    errs no more. `noisy`: on the front, but the rounds don't rank its time and that of its neighbour there.
    Rows of the object `ALL` hold means over the objects.
    """
    methods = study.methods()
    found: dict[str, dict[Method, tuple[dict[str, float], float, Timing]]] = {}
    for name, case in study.cases():
        log.info("%s: %s, %d methods", study.stage, name, len(methods))
        errors, memory = {}, {}
        for number, method in enumerate(methods):
            result, memory[number] = with_peak_memory(lambda m=method, case=case: m.run(case))
            errors[number] = study.errors(case, result)
            del result
            log.info("  %s: %s", method, errors[number])
        calls = {number: lambda m=method, case=case: m.run(case) for number, method in enumerate(methods)}
        times = interleaved(calls, rounds, warm=True)
        found[name] = {m: (errors[k], memory[k], times[k]) for k, m in enumerate(methods)}
    if len(found) > 1:
        found[ALL] = {m: _together([of[m] for of in found.values()], study.units) for m in methods}
    rows = [row for name, of in found.items() for row in _rows(study, name, of, rounds)]
    table = pd.DataFrame(rows, columns=list(COLUMNS))
    for row in table[table["noisy"] & table["drawn"] & (table["object"] == ALL)].itertuples():
        log.warning(
            "%s, %s: this machine is too noisy to rank %s %s %s against its neighbour on the front in "
            "%d rounds: raise reports.rounds, or leave the machine alone",
            row.stage, row.measure, row.method, row.knob, row.value, rounds,
        )  # fmt: skip
    return table


def setting(knob: str, value: Any) -> str:
    """A knob and its value, as it is read: numbers without needless digits."""
    try:
        return f"{knob} {float(value):g}"
    except ValueError:
        return f"{knob} {value}"


def over_objects(table: pd.DataFrame) -> pd.DataFrame:
    """Of each stage the rows that stand for all of its objects; its only object's where it has one."""
    together = set(table.loc[table["object"] == ALL, "stage"])
    return table[(table["object"] == ALL) | ~table["stage"].isin(together)]


def _together(found: list, units: Mapping[str, str]) -> tuple[dict[str, float], float, Timing]:
    """One method on several objects: mean errors, the largest memory, the mean time round by round."""
    errors = {key: float(np.mean([errors[key] for errors, _, _ in found])) for key in units}
    together = timing(np.mean([each.rounds for _, _, each in found], axis=0))
    return errors, max(memory for _, memory, _ in found), together


def _rows(study: Study, name: str, found: Mapping[Method, tuple], rounds: int) -> list[dict[str, Any]]:
    rows = []
    for number, (measured, unit) in enumerate(study.units.items()):
        methods = list(found)
        times = [found[m][2] for m in methods]
        best = front([t.seconds for t in times], [found[m][0][measured] for m in methods])
        noisy = _noisy(times, best)
        for method, on, doubtful in zip(methods, best, noisy, strict=True):
            errors, memory, taken = found[method]
            rows.append(
                {
                    "stage": study.stage,
                    "object": name,
                    "method": method.name,
                    "knob": method.knob,
                    "value": method.value,
                    "chosen": method.chosen,
                    "measure": measured,
                    "drawn": number < study.panels,
                    "error": errors[measured],
                    "unit": unit,
                    "reference": study.reference,
                    "seconds": taken.seconds,
                    "seconds_low": taken.low,
                    "seconds_high": taken.high,
                    "rounds": rounds,
                    "peak_mib": memory / 2**20,
                    "front": bool(on),
                    "noisy": bool(doubtful),
                }
            )
    return rows


def _noisy(times: list[Timing], best: np.ndarray) -> np.ndarray:
    """Which methods on the front the rounds don't rank in time against the next on it: (n,) bool."""
    ranked = sorted(np.flatnonzero(best), key=lambda k: times[k].seconds)
    noisy = np.zeros(len(times), dtype=bool)
    for one, other in zip(ranked, ranked[1:], strict=False):
        if not differs_significantly(times[one], times[other]):
            noisy[[one, other]] = True
    return noisy
