"""The Pareto front: methods that no other beats in both error and time."""

import numpy as np


def front(seconds: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Which methods are on the Pareto front: (n,) bool.

    A method is not on it if another is at least as good in time and error, and better in one of them. Nor is one
    whose error is NaN or whose time is not finite.

    Args:
        seconds, error: (n,).
    """
    s, e = np.asarray(seconds, dtype=float), np.asarray(error, dtype=float)
    known = np.isfinite(s) & ~np.isnan(e)
    no_worse = (s[None] <= s[:, None]) & (e[None] <= e[:, None])
    better = (s[None] < s[:, None]) | (e[None] < e[:, None])
    return known & ~(no_worse & better & known).any(axis=1)
