"""Interleaved timing, significant differences."""

import time

import numpy as np
import pytest

from studies.timing import Timing, differs_significantly, interleaved


def of(*rounds):
    return Timing(float(np.median(rounds)), min(rounds), max(rounds), np.array(rounds, dtype=float))


def test_every_method_is_called_in_every_round_and_once_before():
    called = []
    functions = {name: (lambda name=name: (called.append(name), time.sleep(0.006))) for name in "abc"}
    times = interleaved(functions, rounds=4)
    assert called[:3] == list("abc")
    rounds = np.array(called[3:]).reshape(4, 3)
    assert all(sorted(row) == list("abc") for row in rounds.tolist())
    assert len({tuple(row) for row in rounds.tolist()}) > 1, "the order is the same in every round"
    for timing in times.values():
        assert timing.low <= timing.seconds <= timing.high and len(timing.rounds) == 4
        assert timing.rounds.min() >= 0.006
    called.clear()
    interleaved(functions, rounds=2, warm=True)
    assert len(called) == 6


def test_short_methods_are_called_several_times():
    count = [0]

    def quick():
        count[0] += 1

    timing = interleaved({"quick": quick}, rounds=3)["quick"]
    assert count[0] > 1000 and timing.seconds < 1e-4


@pytest.mark.parametrize(("methods", "rounds"), [({}, 5), ({"a": lambda: 0}, 0)])
def test_nothing_to_time(methods, rounds):
    with pytest.raises(ValueError, match="at least one"):
        interleaved(methods, rounds)


def test_methods_are_differs_significantly_by_their_ratio_and_not_by_the_machines_drift():
    drift = np.array([1.0, 3.0, 0.5, 7.0, 2.0])
    wobble = np.array([1.0, 1.02, 0.99, 1.01, 1.0])
    assert differs_significantly(of(*drift), of(*(1.1 * drift * wobble)))
    assert not differs_significantly(of(*drift), of(*(1.001 * drift * wobble)))
    assert not differs_significantly(of(1.0), of(2.0))
    assert not differs_significantly(of(1.0, 1.0), of(1.0, 1.0))
    assert differs_significantly(of(1.0, 1.0), of(2.0, 2.0))
