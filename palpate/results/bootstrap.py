"""Averages over classes with bootstrap intervals over objects and seeds, and of what is computed from them.

An experiment's errors are an array (k seeds, n objects). Its average is the mean over classes of the mean over a
class's objects (and over seeds), as in the paper's tables. A difference is paired by objects and seeds.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

RESAMPLES = 2000
STEP = 1e-4  # of the means, relative, for the slope of a statistic
# A variance between two or three seeds is often far too small by chance. Welch and Satterthwaite's degrees of freedom
# are then those of the many objects. So it counts 1 + 8 / f^2 times in them, f being its own degrees. Intervals then
# contain the truth in 94 to 97 of 100 simulated runs, instead of 88 to 95 (docs/evidence/evaluation.md).
SEEDS_WEIGHT = 8.0

Statistic = Callable[[np.ndarray], np.ndarray]  # from averages (..., experiments) to numbers (...)


class Estimate(NamedTuple):
    """A number with its 95 % interval, nan where it can't be estimated."""

    value: float
    low: float
    high: float

    def within(self, least: float, most: float = np.inf) -> "Estimate":
        return self._replace(low=float(np.clip(self.low, least, most)), high=float(np.clip(self.high, least, most)))

    def columns(self, label: str, scale: float = 1.0) -> dict[str, float]:
        """The columns of a table with the number and its interval, times `scale`."""
        return {label: scale * self.value, f"{label}_low": scale * self.low, f"{label}_high": scale * self.high}

    def sign(self, spread: float = np.nan) -> int:
        """-1 or 1 if the number is a finding: if its interval excludes 0 and it is larger than `spread`, how far two
        seeds differ in it (nan: not known). Else 0: it is undecided."""
        return 0 if abs(self.value) <= spread else int(self.low > 0) - int(self.high < 0)


def first(means: np.ndarray) -> np.ndarray:
    return means[..., 0]


def ratio(means: np.ndarray) -> np.ndarray:
    """The first average over the second; nan where that is zero, as where only objects without touches were drawn."""
    above, below = means[..., 0], means[..., 1]
    return np.divide(above, below, out=np.full_like(above, np.nan), where=below > 0)


def interval(
    values: Sequence[np.ndarray],
    classes: np.ndarray,
    statistic: Statistic = first,
    resamples: int = RESAMPLES,
    seed: int = 0,
) -> Estimate:
    """A statistic of the experiments' averages, by default the first one's, with its bootstrap interval.
    values: one (k, n) array an experiment: its error with each of k seeds, the same and in the same order for all
    experiments, for each of n objects. One of a single seed, (1, n), is the same for every seed.
    classes: (n,) class of each object.

    The pigeonhole bootstrap (Owen 2007, section 3): objects are drawn within their class and seeds apart from them,
    both the same for all experiments. For a difference y_so = m + a_s + b_o + e_so of seed s and object o its variance
    is var(a) / k + var(b) / n + 3 var(e) / (k n): right for seeds and objects, and if at all too wide for what is left.
    Of n objects (or k seeds) n - 1 are drawn, so that the variance of a mean of few is unbiased (McCarthy and Snowden
    1985). The interval is Student's on the bootstrap's standard error (Efron and Tibshirani 1993, section 12.2), with
    Welch's and Satterthwaite's degrees of freedom (see `SEEDS_WEIGHT`). With one seed it is over objects only. A class
    with one object shows no spread, and the interval is (nan, nan). Raises ValueError if the arrays do not fit each
    other, hold no object, or are not finite."""
    from scipy.special import stdtrit

    values, classes = _checked(values, classes)
    means = np.array([_class_weights(classes) @ array.mean(axis=0) for array in values])
    value = float(statistic(means))
    step = np.diag(STEP * np.maximum(np.abs(means), 1e-12))
    slopes = (statistic(means + step) - statistic(means - step)) / (2 * np.diag(step))
    freedom = _degrees_of_freedom(values, classes, slopes)
    if np.isnan(freedom):
        return Estimate(value, np.nan, np.nan)
    replicates = statistic(_replicates(values, classes, resamples, seed))
    half = float(stdtrit(freedom, (1 + 0.95) / 2) * np.nanstd(replicates, ddof=1))
    return Estimate(value, value - half, value + half)


def between_seeds(values: Sequence[np.ndarray], classes: np.ndarray, statistic: Statistic = first) -> float:
    """How far two seeds differ in a statistic of the experiments' averages: the mean of |difference| over all pairs of
    seeds (Gini's mean difference). nan with one seed. Arguments and errors are those of `interval`."""
    values, classes = _checked(values, classes)
    weights = _class_weights(classes)
    seeds = max(map(len, values))
    by_seed = statistic(np.stack([np.broadcast_to(array @ weights, seeds) for array in values], axis=1))
    one, other = np.triu_indices(seeds, k=1)
    return float(np.abs(by_seed[one] - by_seed[other]).mean()) if seeds > 1 else np.nan


def ratio_interval(numerator: np.ndarray, denominator: np.ndarray, classes: np.ndarray) -> Estimate:
    """sum(numerator) / sum(denominator) over objects of all classes, with the interval of `interval`.
    numerator, denominator, classes: (n,), one entry an object, for example its successful touches and its touches. An
    object counts by its denominator here, not by the size of its class. The value is nan where the denominator is zero.
    The interval is (nan, nan) there too, where a class has a single object, and where no object differs: none of 80
    objects does not mean none of all. Raises ValueError as `interval` does."""
    numerator, denominator = np.asarray(numerator, float), np.asarray(denominator, float)
    if denominator.sum() == 0:
        return Estimate(np.nan, np.nan, np.nan)
    # `interval` averages over classes; weighed by their sizes, its averages are sums over all objects.
    _, index, counts = np.unique(classes, return_inverse=True, return_counts=True)
    _, low, high = interval([numerator * counts[index], denominator * counts[index]], classes, ratio)
    value = float(numerator.sum() / denominator.sum())
    return Estimate(value, low, high) if low < high else Estimate(value, np.nan, np.nan)


def _checked(values: Sequence[np.ndarray], classes: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
    values = [np.atleast_2d(np.asarray(array, dtype=float)) for array in values]
    classes = np.asarray(classes)
    shapes = [array.shape for array in values]
    if not len(classes) or not shapes or any(k == 0 or n != len(classes) for k, n in shapes):
        raise ValueError(f"(seeds, {len(classes)} objects) expected for each experiment, got {shapes}")
    if len({k for k, _ in shapes if k > 1}) > 1:
        raise ValueError(f"differences are paired by seed: as many seeds expected for each experiment, got {shapes}")
    if not all(np.isfinite(array).all() for array in values):
        raise ValueError("errors must be finite")
    return values, classes


def _class_weights(classes: np.ndarray) -> np.ndarray:
    """(n,) weights of objects: each class has the same share."""
    _, index, counts = np.unique(classes, return_inverse=True, return_counts=True)
    return 1 / (len(counts) * counts[index])


def _replicates(values: Sequence[np.ndarray], classes: np.ndarray, resamples: int, seed: int) -> np.ndarray:
    """(resamples, experiments) averages over objects and seeds that were drawn."""
    rng, weights = np.random.default_rng(seed), np.zeros((resamples, len(classes)))
    for name in np.unique(classes):
        members = np.flatnonzero(classes == name)
        weights[:, members] = _drawn(len(members), resamples, rng) / len(np.unique(classes))
    seeds = _drawn(max(map(len, values)), resamples, rng)
    return np.stack(
        [np.einsum("rk,rk->r", weights @ array.T, seeds) if len(array) > 1 else weights @ array[0] for array in values],
        axis=1,
    )


def _drawn(count: int, resamples: int, rng: np.random.Generator) -> np.ndarray:
    """(resamples, count) shares of each of `count` among count - 1 drawn with replacement; 1 of a single one."""
    if count == 1:
        return np.ones((resamples, 1))
    return rng.multinomial(count - 1, np.full(count, 1 / count), size=resamples) / (count - 1)


def _degrees_of_freedom(values: Sequence[np.ndarray], classes: np.ndarray, slopes: np.ndarray) -> float:
    """Welch and Satterthwaite's, of the statistic to first order; nan where a class has a single object."""
    by_object = sum(slope * array.mean(axis=0) for slope, array in zip(slopes, values, strict=True))
    names, counts = np.unique(classes, return_counts=True)
    if counts.min() < 2:
        return np.nan
    parts = [
        (by_object[classes == name].var(ddof=1) / count / len(names) ** 2, count - 1)
        for name, count in zip(names, counts, strict=True)
    ]
    seeds = max(map(len, values))
    if seeds > 1:
        weights = _class_weights(classes)
        by_seed = sum(slope * (array @ weights) for slope, array in zip(slopes, values, strict=True))
        weight = 1 + SEEDS_WEIGHT / (seeds - 1) ** 2
        parts.append((weight * np.broadcast_to(by_seed, seeds).var(ddof=1) / seeds, seeds - 1))
    variance, freedom = np.array(parts).T
    total = variance.sum()
    # Nothing varies: the interval has no width, whatever it is stretched by.
    return float(total**2 / (variance**2 / freedom).sum()) if total > 0 else np.inf
