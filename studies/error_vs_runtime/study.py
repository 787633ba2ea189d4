"""Error against run time of the methods of one stage, object by object.

A study defines methods, cases and errors. `measure` runs every method on every case and makes the rows of
`reports/error_vs_runtime.csv`.
"""

import logging
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from studies.subjects import Subject
from studies.timing import ROUNDS, Timing, differs_significantly, interleaved, timing

log = logging.getLogger(__name__)

COLUMNS = (
    *("stage", "object", "method", "knob", "value", "chosen", "measure", "drawn", "error", "unit", "reference"),
    *("seconds", "seconds_low", "seconds_high", "rounds", "front", "noisy"),
)
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


def variants(name: str, knob: str, values: Iterable, make: Callable, chosen: Any = None) -> list[Method]:
    """A method at each value of a knob; make: from a value to what runs it. chosen: the config's value."""
    return [Method(name, knob, value, make(value), value == chosen) for value in values]


class Study(ABC):
    """A comparison of the methods of one stage, on objects of a run.

    stage: its name in the report. units: the measures of error and their units. reference: what errors are against, in
    words. panels: how many measures, from the first, the figure draws. objects: how many subjects are used at most.
    case: makes the case of one subject; a study whose cases are no subjects' overrides `cases` instead.
    """

    stage: str
    units: Mapping[str, str]
    reference: str
    panels: int = 1
    objects: int | None = None
    case: Callable[[Subject], Any]

    def __init__(self, run: Path | None = None, subjects: Sequence[Subject] = (), settings: Mapping | None = None):
        """settings: the sections of the config that `studies.items` names."""
        self.run, self.subjects, self.settings = run, subjects[: self.objects], settings or {}

    def cases(self) -> Iterable[tuple[str, Any]]:
        """Names of objects, and the case of each that methods take."""
        for subject in self.subjects:
            yield subject.name, self.case(subject)

    @abstractmethod
    def methods(self) -> list[Method]:
        """All methods that are compared."""

    @abstractmethod
    def errors(self, case: Any, result: Any) -> dict[str, float]:
        """Errors of a result: a number for each key of `units`, NaN where one is undefined."""


class Measured(NamedTuple):
    """One method on one case."""

    errors: dict[str, float]
    time: Timing


def measure(study: Study, rounds: int = ROUNDS) -> pd.DataFrame:
    """Run every method on every case: a row for each case, method and measure, with the columns `COLUMNS`.

    Seconds are the median and the quartiles of the rounds. `front`: no other method on this object is faster with at
    most the same error. `noisy`: on the front, but its time does not differ significantly from that of its neighbour
    there. Rows of the object `ALL` are means over the objects.
    """
    methods, objects = study.methods(), {}
    for name, case in study.cases():
        log.info("%s: %s, %d methods", study.stage, name, len(methods))
        calls = {number: partial(method.run, case) for number, method in enumerate(methods)}
        errors = []
        for number, method in enumerate(methods):
            errors.append(study.errors(case, calls[number]()))
            log.info("  %s: %s", method, errors[-1])
        times = interleaved(calls, rounds, warm=True)
        objects[name] = [Measured(of_method, times[number]) for number, of_method in enumerate(errors)]
    if len(objects) > 1:
        objects[ALL] = [_mean_over_objects(of_method) for of_method in zip(*objects.values(), strict=True)]
    rows = [row for name, measured in objects.items() for row in _rows(study, name, methods, measured, rounds)]
    table = pd.DataFrame(rows, columns=list(COLUMNS))
    noisy = table[table["noisy"] & table["drawn"] & (table["object"] == ALL)]
    for measure, doubtful in noisy.groupby("measure", sort=False):
        which = ", ".join(f"{row.method} {setting(row.knob, row.value)}" for row in doubtful.itertuples())
        what = f"{study.stage}, {measure}: this machine is too noisy to rank, of the front, {which}"
        log.warning("%s: raise reports.rounds, or leave the machine alone", what)
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


def front(seconds: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Which methods, with seconds (n,) and error (n,), are on the Pareto front: (n,) bool.

    A method is not on it if another is at least as good in time and error, and better in one of them. Nor is one
    whose error is NaN or whose time is not finite.
    """
    s, e = np.asarray(seconds, dtype=float), np.asarray(error, dtype=float)
    known = np.isfinite(s) & ~np.isnan(e)
    no_worse = (s[None] <= s[:, None]) & (e[None] <= e[:, None])
    better = (s[None] < s[:, None]) | (e[None] < e[:, None])
    return known & ~(no_worse & better & known).any(axis=1)


def _mean_over_objects(measured: Iterable[Measured]) -> Measured:
    """One method on several objects: mean errors, the mean time round by round."""
    errors, times = zip(*measured, strict=True)
    means = {key: float(np.mean([of_object[key] for of_object in errors])) for key in errors[0]}
    return Measured(means, timing(np.mean([time.rounds for time in times], axis=0)))


def _rows(study: Study, name: str, methods: list[Method], measured: list[Measured], rounds: int) -> Iterable[dict]:
    times = [on_case.time for on_case in measured]
    for number, (key, unit) in enumerate(study.units.items()):
        on_front = front([time.seconds for time in times], [on_case.errors[key] for on_case in measured])
        shared = {"stage": study.stage, "object": name, "measure": key, "drawn": number < study.panels, "unit": unit}
        shared |= {"reference": study.reference, "rounds": rounds}
        each_method = zip(methods, measured, on_front, _noisy(times, on_front), strict=True)
        for method, (errors, time), is_on_front, noisy in each_method:
            yield shared | {
                **dict(zip(("method", "knob", "value"), method[:3], strict=True)),
                **dict(zip(("seconds", "seconds_low", "seconds_high"), time[:3], strict=True)),
                **{"chosen": method.chosen, "error": errors[key]},
                **{"front": bool(is_on_front), "noisy": bool(noisy)},
            }


def _noisy(times: list[Timing], on_front: np.ndarray) -> np.ndarray:
    """Which methods on the front don't differ significantly in time from a neighbour there: (n,) bool."""
    ranked = sorted(np.flatnonzero(on_front), key=lambda k: times[k].seconds)
    noisy = np.zeros(len(times), dtype=bool)
    for one, other in zip(ranked, ranked[1:], strict=False):
        if not differs_significantly(times[one], times[other]):
            noisy[[one, other]] = True
    return noisy
