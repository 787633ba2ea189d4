"""Times of several methods, measured alternately in one process."""

import time
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy import stats

ROUNDS = 5
# Seconds. A shorter function is called repeatedly: the clock and a call cost a microsecond.
MINIMUM_DURATION = 0.005
# Two methods differ significantly if zero is outside this interval of the logarithm of their ratio, round by round.
CONFIDENCE = 0.95


class Timing(NamedTuple):
    """Seconds of a method: median, quartiles, and each round's."""

    seconds: float
    low: float
    high: float
    rounds: np.ndarray


def interleaved(
    methods: Mapping[str, Callable[[], object]],
    rounds: int = ROUNDS,
    warm: bool = False,
) -> dict[str, Timing]:
    """Time each method once in every round, in random order.

    Other load on the machine then affects all of them, and cancels in their ratios. A short method is called several
    times a round. warm: each method was called before; otherwise it is called once untimed, to build what it caches.

    Raises ValueError if there is no method or no round.
    """
    if not methods or rounds < 1:
        raise ValueError(f"{len(methods)} methods in {rounds} rounds: at least one of each")
    if not warm:
        for function in methods.values():
            function()
    order, seconds = np.random.default_rng(0), {name: [] for name in methods}
    for _ in range(rounds):
        for name in order.permutation(list(methods)):
            seconds[name].append(_seconds(methods[name]))
    return {name: timing(values) for name, values in seconds.items()}


def _seconds(function: Callable[[], object]) -> float:
    """Seconds of a call, the mean over as many calls as take `MINIMUM_DURATION`."""
    calls, start = 0, time.perf_counter()
    while True:
        function()
        calls += 1
        spent = time.perf_counter() - start
        if spent >= MINIMUM_DURATION:
            return spent / calls


def timing(rounds: Sequence[float] | np.ndarray) -> Timing:
    """The timing of a method from the seconds of its rounds (r,)."""
    low, median, high = np.percentile(rounds, [25, 50, 75])
    return Timing(float(median), float(low), float(high), np.asarray(rounds, dtype=float))


def differs_significantly(one: Timing, other: Timing) -> bool:
    """Whether two methods differ in time: Student's interval of the mean log ratio excludes 0.

    Both timings must be of the same rounds. False for a single round and for equal times.
    """
    ratio = np.log(one.rounds) - np.log(other.rounds)
    spread = stats.sem(ratio) if len(ratio) > 1 else np.inf
    if not np.isfinite(spread):
        return False
    if spread == 0:
        return bool(ratio.mean() != 0)
    return bool(abs(ratio.mean()) > spread * stats.t.ppf((1 + CONFIDENCE) / 2, len(ratio) - 1))
