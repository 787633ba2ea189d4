"""Error against run time of the methods of one stage, object by object.

A study defines methods, cases and errors. `measure` runs every method on every case and makes the rows of
`reports/error_vs_runtime.csv`.
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
ALL = "all"  # the object of rows that are means over all objects


class Method(NamedTuple):
    """A method with one knob at one value.

    run: makes a result from a case, deterministically. chosen: whether the run's config uses it.
    """

    name: str
    knob: str
    value: Any
    run: Callable[[Any], Any]
    chosen: bool = False

    def __str__(self) -> str:
        return f"{self.name}, {self.knob} {self.value}"


class Study(ABC):
    """A comparison of the methods of one stage.

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
        """Names of objects, and the case of each that methods take."""

    @abstractmethod
    def methods(self) -> list[Method]:
        """All methods that are compared."""

    @abstractmethod
    def errors(self, case: Any, result: Any) -> dict[str, float]:
        """Errors of a result: a number for each key of `units`, NaN where one is undefined."""


def measure(study: Study, rounds: int = ROUNDS) -> pd.DataFrame:
    """Run every method on every case: a row for each case, method and measure, with the columns `COLUMNS`.

    Seconds are the median and the quartiles of the rounds (`studies.timing`). The peak memory is the rise of the
    process's memory in the method's first run. `front`: no other method on this object is faster with at most the
    same error. `noisy`: on the front, but its time does not differ significantly from that of its neighbour there.
    Rows of the object `ALL` are means over the objects.
    """
    methods = study.methods()
    measurements: dict[str, dict[Method, tuple[dict[str, float], float, Timing]]] = {}
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
        measurements[name] = {m: (errors[k], memory[k], times[k]) for k, m in enumerate(methods)}
    if len(measurements) > 1:
        measurements[ALL] = {
            m: _mean_over_objects([of[m] for of in measurements.values()], study.units) for m in methods
        }
    rows = [row for name, of in measurements.items() for row in _rows(study, name, of, rounds)]
    table = pd.DataFrame(rows, columns=list(COLUMNS))
    for row in table[table["noisy"] & table["drawn"] & (table["object"] == ALL)].itertuples():
        log.warning(
            "%s, %s: this machine is too noisy to rank %s %s %s against its neighbour on the front in "
            "%d rounds: raise reports.rounds, or leave the machine alone",
            row.stage, row.measure, row.method, row.knob, row.value, rounds,
        )  # fmt: skip
    return table


def setting(knob: str, value: Any) -> str:
    """A knob and its value as text, numbers without needless digits."""
    try:
        return f"{knob} {float(value):g}"
    except ValueError:
        return f"{knob} {value}"


def over_objects(table: pd.DataFrame) -> pd.DataFrame:
    """The rows of each stage that are means over its objects; of a stage with one object, the rows of that one."""
    together = set(table.loc[table["object"] == ALL, "stage"])
    return table[(table["object"] == ALL) | ~table["stage"].isin(together)]


def _mean_over_objects(measurements: list, units: Mapping[str, str]) -> tuple[dict[str, float], float, Timing]:
    """One method on several objects: mean errors, the largest memory, the mean time round by round."""
    errors = {key: float(np.mean([errors[key] for errors, _, _ in measurements])) for key in units}
    together = timing(np.mean([each.rounds for _, _, each in measurements], axis=0))
    return errors, max(memory for _, memory, _ in measurements), together


def _rows(study: Study, name: str, measurements: Mapping[Method, tuple], rounds: int) -> list[dict[str, Any]]:
    rows = []
    for number, (measured, unit) in enumerate(study.units.items()):
        methods = list(measurements)
        times = [measurements[m][2] for m in methods]
        on_front = front([t.seconds for t in times], [measurements[m][0][measured] for m in methods])
        noisy = _noisy(times, on_front)
        for method, is_on_front, doubtful in zip(methods, on_front, noisy, strict=True):
            errors, memory, times_of_method = measurements[method]
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
                    "seconds": times_of_method.seconds,
                    "seconds_low": times_of_method.low,
                    "seconds_high": times_of_method.high,
                    "rounds": rounds,
                    "peak_mib": memory / 2**20,
                    "front": bool(is_on_front),
                    "noisy": bool(doubtful),
                }
            )
    return rows


def _noisy(times: list[Timing], on_front: np.ndarray) -> np.ndarray:
    """Which methods on the front don't differ significantly in time from a neighbour there: (n,) bool."""
    ranked = sorted(np.flatnonzero(on_front), key=lambda k: times[k].seconds)
    noisy = np.zeros(len(times), dtype=bool)
    for one, other in zip(ranked, ranked[1:], strict=False):
        if not differs_significantly(times[one], times[other]):
            noisy[[one, other]] = True
    return noisy
