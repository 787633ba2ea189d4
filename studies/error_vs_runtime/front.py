"""The front of best methods: those that no other beats in both error and time."""

import numpy as np


def front(seconds: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Which methods are on the front: (n,) bool.

    A method is off it if another takes no longer and errs no more, and is better in one of the two; also if
    its error is NaN, or its time not finite.

    Args:
        seconds, error: (n,).
    """
    s, e = np.asarray(seconds, dtype=float), np.asarray(error, dtype=float)
    known = np.isfinite(s) & ~np.isnan(e)
    no_worse = (s[None] <= s[:, None]) & (e[None] <= e[:, None])
    better = (s[None] < s[:, None]) | (e[None] < e[:, None])
    return known & ~(no_worse & better & known).any(axis=1)
