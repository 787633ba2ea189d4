"""The rows that a study makes."""

import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from studies.error_vs_runtime.study import ALL, COLUMNS, Method, Study, front, measure
from studies.timing import timing


class Sums(Study):
    """Adding up numbers: exactly and slowly, or from the first half, or badly and slowly."""

    stage = "sums"
    units = {"sum": "m", "sign": "1"}
    reference = "numpy in double precision"

    def cases(self):
        yield "ones", np.ones(1000)
        yield "ramp", np.arange(1000.0)

    def methods(self):
        def slowly(result):
            return lambda case: (time.sleep(0.006), result(case))[1]

        return [
            Method("exact", "share", 1.0, slowly(np.sum), chosen=True),
            Method("half", "share", 0.5, lambda case: 2 * case[:500].sum()),
            Method("bad", "share", 0.0, slowly(lambda case: -case.sum())),
        ]

    def errors(self, case, result):
        return {"sum": abs(result - case.sum()), "sign": float(result < 0)}


@pytest.fixture(scope="module")
def table():
    return measure(Sums(), rounds=5)


def test_every_method_object_and_measure_has_a_row(table):
    assert tuple(table.columns) == COLUMNS
    assert len(table) == 3 * 2 * (2 + 1)
    assert not table.duplicated(["object", "method", "measure"]).any()
    assert (table["drawn"] == (table["measure"] == "sum")).all()
    assert (table["rounds"] == 5).all()
    assert (table["seconds_low"] <= table["seconds"]).all() and (table["seconds"] <= table["seconds_high"]).all()


def test_errors_front_and_means(table):
    table = table.set_index(["object", "measure", "method"]).sort_index()
    of = table["error"]
    assert of["ones", "sum", "half"] == 0 and of["ramp", "sum", "half"] == pytest.approx(499500 - 2 * 124750)
    assert of[ALL, "sum", "half"] == pytest.approx((499500 - 2 * 124750) / 2)
    on = table["front"]
    # On ones half is as right as exact, and faster; on a ramp both are on the front; bad never is.
    assert on["ones", "sum"].to_dict() == {"exact": False, "half": True, "bad": False}
    assert on["ramp", "sum"].to_dict() == {"exact": True, "half": True, "bad": False}
    seconds = table["seconds"]
    assert seconds[ALL, "sum", "exact"] > 0.006 > seconds[ALL, "sum", "half"]
    assert table["chosen"].groupby("method").all().to_dict() == {"exact": True, "half": False, "bad": False}


def test_methods_whose_times_can_not_be_ranked_are_noisy(caplog, monkeypatch):
    """Fast and bad, slow and exact; whether the rounds tell one from the other is the only difference."""
    fast = [1.0, 2.0, 1.5, 1.2, 1.1]
    slow = {True: [1.1, 1.9, 1.6, 1.3, 1.1], False: [2.1, 3.9, 3.1, 2.4, 2.2]}
    for doubtful, rounds in slow.items():
        monkeypatch.setattr(
            "studies.error_vs_runtime.study.interleaved",
            lambda calls, *_, rounds=rounds, **__: {0: timing(rounds), 1: timing(fast), 2: timing(rounds)},
        )
        caplog.clear()
        table = measure(Sums()).set_index(["object", "measure", "method"]).sort_index()
        on_ramp = table.loc["ramp", "sum"]
        assert on_ramp["front"].to_dict() == {"exact": True, "half": True, "bad": False}
        assert on_ramp["noisy"].to_dict() == {"exact": doubtful, "half": doubtful, "bad": False}
        assert ("too noisy to rank" in caplog.text) == doubtful


numbers = st.sampled_from([0.0, 1.0, 2.0, 3.0, float("inf"), float("nan")])


@given(st.lists(st.tuples(numbers, numbers), max_size=8))
def test_on_the_front_is_what_nothing_beats(points):
    seconds = np.array([s for s, _ in points])
    error = np.array([e for _, e in points])

    def known(k):
        return np.isfinite(seconds[k]) and not np.isnan(error[k])

    def beaten(k):
        return any(
            known(j)
            and seconds[j] <= seconds[k]
            and error[j] <= error[k]
            and (seconds[j] < seconds[k] or error[j] < error[k])
            for j in range(len(points))
        )

    assert front(seconds, error).tolist() == [known(k) and not beaten(k) for k in range(len(points))]
