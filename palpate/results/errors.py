"""The evaluations of a run's experiments, read back: errors by seed and object, ready to be averaged."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from palpate.learning.rows import EvaluationError
from palpate.results.bootstrap import RESAMPLES, Estimate, Statistic, between_seeds, first, interval
from palpate.results.published import PAPER_CLASSES

if TYPE_CHECKING:
    from pandas import DataFrame as Frame

AVERAGE = "average"


class Errors(NamedTuple):
    """Errors of some experiments on the n objects of one split."""

    objects: np.ndarray  # (n,) names, as are the classes
    classes: np.ndarray
    values: dict[str, np.ndarray]  # experiment -> (k, n): with each of k seeds, the mean over an object's windows
    steps: dict[str, tuple[int, int]]  # experiment -> training steps of its best seeds, least and greatest

    @property
    def class_names(self) -> list[str]:
        """The classes, the paper's first and in its order."""
        names = sorted(set(self.classes))
        return [name for name in PAPER_CLASSES if name in names] + [name for name in names if name not in PAPER_CLASSES]

    def of_class(self, name: str) -> Errors:
        return self.select(self.classes == name)

    def select(self, chosen: np.ndarray) -> Errors:
        """The errors on some of the objects; chosen: (n,) bool."""
        values = {experiment: array[:, chosen] for experiment, array in self.values.items()}
        return self._replace(objects=self.objects[chosen], classes=self.classes[chosen], values=values)

    def estimate(
        self, experiments: Sequence[str], statistic: Statistic = first, resamples: int = RESAMPLES
    ) -> Estimate:
        """A statistic of the averages of some experiments, with its interval; by default the first's average,
        whose interval ends at 0, because errors are not negative."""
        found = interval([self.values[name] for name in experiments], self.classes, statistic, resamples)
        return found.within(0) if statistic is first else found

    def median(self, experiments: Sequence[str], statistic: Statistic = first) -> float:
        """The median over objects of a statistic of some experiments' errors, each the mean over seeds."""
        by_object = np.stack([self.values[name].mean(axis=0) for name in experiments], axis=1)
        return float(np.median(statistic(by_object)))

    def between_seeds(self, experiments: Sequence[str], statistic: Statistic = first) -> float:
        """How far two seeds differ in a statistic of averages; nan with one seed, and if nothing of it is trained."""
        if not any(self.steps[name][1] for name in experiments):
            return np.nan
        return between_seeds([self.values[name] for name in experiments], self.classes, statistic)


def of_split(
    frame: Frame, experiments: Iterable[str], split: str, key: str = "experiment", what: str = "evaluation"
) -> Frame:
    """The rows of some experiments on a split. Raises EvaluationError for one without."""
    frame = frame[frame["split"] == split]
    known = set(frame[key])
    for name in experiments:
        if name not in known:
            raise EvaluationError(f"no {what} of experiment {name!r} on the {split} split; there are {sorted(known)}")
    return frame[frame[key].isin(experiments)]


def errors(
    frame: Frame, experiments: Sequence[str], split: str, column: str = "chamfer", key: str = "experiment"
) -> Errors:
    """The errors of experiments on one split, object by object. frame: rows of `palpate.learning.rows.read`; `column`
    holds the error, `key` names the experiment. Raises EvaluationError if an experiment has no rows, experiments were
    measured on different objects or trained with different seeds, one was measured twice, or an error is not finite."""
    frame = of_split(frame, experiments, split, key)
    if not np.isfinite(frame[column]).all():
        bad = frame[~np.isfinite(frame[column])].iloc[0]
        raise EvaluationError(f"{bad[key]!r}, seed {bad['seed']}, {bad['object']}: {column} is {bad[column]}")
    names = [name for name in (key, "seed", "object", "window", "grasp", "sensor", "ring") if name in frame]
    if (twice := frame.duplicated(names)).any():
        raise EvaluationError(f"measured twice: {frame[twice].iloc[0][names].to_dict()}")
    classes = frame.drop_duplicates("object").set_index("object")["class"].sort_index()
    trained = frame["steps"] > 0 if (frame["steps"] > 0).any() else slice(None)
    seeds = sorted(set(frame.loc[trained, "seed"]))
    means = frame.groupby([key, "seed", "object"])[column].mean()
    ends = frame.groupby(key)["steps"].agg(["min", "max"]).astype(int)
    values, steps = {}, {}
    for name in experiments:
        steps[name] = tuple(ends.loc[name].tolist())
        table = means[name].unstack("object")
        if len(table.columns) != len(classes) or table.isna().any(axis=None):
            unmatched = sorted(set(classes.index) - set(table.dropna(axis=1).columns))
            raise EvaluationError(
                f"experiment {name!r} was not measured on {unmatched[:3]} of the {split} split with every seed, "
                "but others were: evaluate all of them on the same dataset"
            )
        if len(table) == 1 and not steps[name][1]:  # What is not trained is measured once, for every seed.
            table = table.loc[[*table.index] * len(seeds)].set_axis(seeds)
        if list(table.index) != seeds:
            raise EvaluationError(
                f"experiment {name!r} was measured with the seeds {list(table.index)}, but others with {seeds}: "
                "differences are paired by seed; train and evaluate it with all of training.seeds"
            )
        values[name] = table.to_numpy()
    return Errors(classes.index.to_numpy(), classes.to_numpy(), values, steps)
