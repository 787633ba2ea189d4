"""Shares over grasps and touches, with bootstrap intervals over objects.

Grasps of one object are alike (same shape, same size), so the object is the unit that is resampled: an
interval over grasps or touches would be too narrow.
"""

import numpy as np

RESAMPLES = 4000  # the 2.5 % and 97.5 % quantiles then vary by about 0.04 standard errors
LEVEL = 0.95
SEED = 0


def ratio_interval(
    numerator: np.ndarray,
    denominator: np.ndarray,
    strata: np.ndarray | None = None,
    level: float = LEVEL,
    resamples: int = RESAMPLES,
    seed: int = SEED,
) -> tuple[float, float]:
    """Percentile bootstrap interval of sum(numerator) / sum(denominator), resampling objects.

    numerator, denominator: (n,), one entry an object, for example its successful touches and its touches.
    strata: (n,) or None; objects are resampled within their stratum (a run fixes the number of objects a
    class, so the class is a stratum of a statistic over all of them).
    Returns (low, high); (nan, nan) where resampling says nothing: the denominator is zero, no stratum has two
    objects, or those that it has do not differ (none of 80 objects does not mean none of all).
    Raises ValueError if the arrays differ in length.
    Source: Efron and Tibshirani, An Introduction to the Bootstrap, 1993, section 13.3.
    """
    numerator, denominator = np.asarray(numerator, float), np.asarray(denominator, float)
    strata = np.zeros(len(numerator), int) if strata is None else np.asarray(strata)
    if not len(numerator) == len(denominator) == len(strata):
        raise ValueError(
            f"one numerator, denominator and stratum an object expected, "
            f"got {len(numerator)}, {len(denominator)} and {len(strata)}"
        )
    names, sizes = np.unique(strata, return_counts=True)
    if not (sizes > 1).any() or denominator.sum() == 0:
        return np.nan, np.nan
    generator = np.random.default_rng(seed)
    totals = np.zeros((resamples, 2))
    for name in names:
        rows = np.stack([numerator, denominator], axis=1)[strata == name]
        times_drawn = generator.multinomial(len(rows), np.full(len(rows), 1 / len(rows)), size=resamples)
        totals += times_drawn @ rows
    ratios = np.divide(totals[:, 0], totals[:, 1], out=np.full(resamples, np.nan), where=totals[:, 1] > 0)
    tail = (1 - level) / 2
    low, high = np.nanquantile(ratios, [tail, 1 - tail])
    return (float(low), float(high)) if low < high else (np.nan, np.nan)


def ratio(numerator: np.ndarray, denominator: np.ndarray) -> float:
    """sum(numerator) / sum(denominator); nan when the denominator is zero."""
    total = np.sum(denominator)
    return float(np.sum(numerator) / total) if total else np.nan
