"""Times of several methods side by side in one run, and the memory that each needs."""

import gc
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np
from scipy import stats

Result = TypeVar("Result")

ROUNDS = 5
# A timing shorter than this is made of several calls: the clock and the call cost a microsecond.
SHORTEST = 0.005
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
    seed: int = 0,
    warm: bool = False,
    clock: Callable[[], float] = time.perf_counter,
) -> dict[str, Timing]:
    """Seconds of each method, taken in rounds: in each round every method once, in random order.

    So what slows the machine for a while slows all of them, and cancels in their ratios. A short method is
    called several times a round.

    Args:
        methods: functions by name; what they return is thrown away.
        rounds: at least 1.
        warm: each was called before; otherwise it is called once untimed, so that what is made at the first
            use is there.
        clock: wall time, or `time.process_time` for processor time.

    Raises ValueError if there is no method or no round.
    """
    if not methods or rounds < 1:
        raise ValueError(f"{len(methods)} methods in {rounds} rounds: at least one of each")
    if not warm:
        for function in methods.values():
            function()
    order = np.random.default_rng(seed)
    taken: dict[str, list[float]] = {name: [] for name in methods}
    for _ in range(rounds):
        for name in order.permutation(list(methods)):
            taken[name].append(_seconds(methods[name], clock))
    return {name: timing(values) for name, values in taken.items()}


def _seconds(function: Callable[[], object], clock: Callable[[], float]) -> float:
    """Of one call; the mean of as many as it takes to be `SHORTEST` long."""
    calls, start = 0, clock()
    while True:
        function()
        calls += 1
        spent = clock() - start
        if spent >= SHORTEST:
            return spent / calls


def timing(rounds: Sequence[float] | np.ndarray) -> Timing:
    """The timing of a method from the seconds of its rounds (r,)."""
    low, median, high = np.percentile(rounds, [25, 50, 75])
    return Timing(float(median), float(low), float(high), np.asarray(rounds, dtype=float))


def differs_significantly(one: Timing, other: Timing) -> bool:
    """Whether the rounds rank two methods: Student's interval of the mean log ratio excludes 0.

    The two must be of the same rounds. False also for a single round, and for equal times.
    """
    ratio = np.log(one.rounds) - np.log(other.rounds)
    spread = stats.sem(ratio) if len(ratio) > 1 else np.inf
    if not np.isfinite(spread):
        return False
    if spread == 0:
        return bool(ratio.mean() != 0)
    return bool(abs(ratio.mean()) > spread * stats.t.ppf((1 + CONFIDENCE) / 2, len(ratio) - 1))


def with_peak_memory(function: Callable[[], Result]) -> tuple[Result, float]:
    """What the function returns, and the bytes by which the process's resident memory rises at most.

    Linux counts the highest point (VmHWM), which can be set back; elsewhere NaN. Memory that the process
    holds already, and fills again, does not count.
    """
    status, reset = Path("/proc/self/status"), Path("/proc/self/clear_refs")
    if not (status.exists() and reset.exists()):
        return function(), float("nan")

    def kibibytes(key: str) -> int:
        return next(int(line.split()[1]) for line in status.read_text().splitlines() if line.startswith(key))

    gc.collect()
    reset.write_text("5")
    before = kibibytes("VmRSS:")
    result = function()
    return result, 1024.0 * max(0, kibibytes("VmHWM:") - before)
