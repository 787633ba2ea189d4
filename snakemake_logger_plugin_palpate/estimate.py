"""How long a run still takes."""

import time
from collections import Counter
from collections.abc import Callable, Mapping

# Seconds that a job of a rule takes, for those that have done none: by docs/evidence/performance.md, and of trainings
# by the default run's. Only their ratios count: they are scaled by what the jobs that are done have taken.
TYPICAL = {
    **{"catalogue_batch": 0.5, "catalogue": 0.5, "rejected": 0.5, "table": 1, "validation": 1, "validate_batch": 3},
    **{"meshes": 8, "surface": 2, "grasps": 7, "touch": 2, "vision": 23, "views": 20, "charts": 7},
    **{"frames": 7, "hold": 20, "rings": 6, "figure": 8, "evaluate": 15, "evaluate_rings": 15, "evaluate_touch": 15},
    **{"touch_depth": 60, "reconstruction": 40},
}
OTHER = 3  # s, of a rule that is not among them
SHOWN_FROM = 0.05  # share of this work that has to be done: what the first quick jobs take says little of the rest
OVERDUE = 0.1  # share of its time so far that a job still needs, if it has run longer than its rule's others


class Estimate:
    """The time that a run has left, from the jobs of each rule that it has done.

    jobs: how many there are of each rule. now: a clock in seconds.
    """

    def __init__(self, jobs: Mapping[str, int], now: Callable[[], float] = time.monotonic):
        self.left, self.now, self.start = Counter(jobs), now, now()
        self.running: dict[int, tuple[str, float]] = {}
        self.took: dict[str, list[float]] = {}

    def begin(self, job: int, rule: str) -> None:
        """A job starts."""
        self.running[job] = rule, self.now()

    def end(self, job: int, done: bool = True) -> None:
        """A job ends. One that failed says nothing of the time that others take."""
        rule, start = self.running.pop(job, ("", 0.0))
        self.left[rule] -= 1
        if done and rule:
            self.took.setdefault(rule, []).append(self.now() - start)

    def so_far(self) -> float:
        """Seconds since the start."""
        return self.now() - self.start

    def seconds(self) -> float | None:
        """Seconds left; None as long as less than `SHOWN_FROM` of the work is done.

        Each job that is left takes the mean time of its rule's. If none of its rule is done, it takes its `TYPICAL`
        time, by as much longer or shorter as those that are done have taken than theirs. A running job
        that has taken longer counts among its rule's with `OVERDUE` more than its time so far. The jobs that run side
        by side are those that have run so on average, and the time left is at least that of the longest.
        """
        times = [seconds for times in self.took.values() for seconds in times]
        done = sum(len(took) * TYPICAL.get(rule, OTHER) for rule, took in self.took.items())
        planned = done + sum(count * TYPICAL.get(rule, OTHER) for rule, count in self.left.items())
        if not times or self.so_far() <= 0 or done < SHOWN_FROM * planned:
            return None
        mean = {rule: TYPICAL.get(rule, OTHER) * sum(times) / done for rule in self.left}
        mean |= {rule: sum(took) / len(took) for rule, took in self.took.items()}
        ages = [(rule, self.now() - start) for rule, start in self.running.values()]
        for rule in {rule for rule, _ in ages}:
            late = [(1 + OVERDUE) * age for running, age in ages if running == rule and age > mean[rule]]
            expected = self.took.get(rule, []) + late
            mean[rule] = sum(expected) / len(expected) if expected else mean[rule]
        left = [max(mean[rule] - age, OVERDUE * age) for rule, age in ages]
        waiting = Counter(self.left) - Counter(rule for rule, _ in ages)
        work = sum(left) + sum(count * mean[rule] for rule, count in waiting.items())
        side_by_side = max(1.0, (sum(times) + sum(age for _, age in ages)) / self.so_far())
        return max(work / side_by_side, *left, 0.0)
