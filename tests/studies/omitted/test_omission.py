"""The rows of what is left out."""

import time

import numpy as np

from studies.omitted.omission import COLUMNS, DIFFERS, SAME, Leaving, report


def leaving(extra: float, **options) -> Leaving:
    def with_it():
        time.sleep(0.02)
        return np.arange(8.0) + extra

    return Leaving(
        scene="grasp",
        part="gravity",
        when="always",
        object="bottle-0000",
        with_it=with_it,
        without=lambda: np.arange(8.0),
        difference=lambda one, other: np.abs(one - other).max(),
        unit="rad",
        **options,
    )


def test_same_within_the_bound_and_what_it_saves(caplog):
    table = report([leaving(0.0), leaving(0.5), leaving(0.5, bound=0.5), leaving(0.5, left_out=False)], rounds=5)
    assert tuple(table.columns) == COLUMNS
    assert table["verdict"].tolist() == [SAME, DIFFERS, SAME, DIFFERS]
    assert table["difference"].tolist() == [0, 0.5, 0.5, 0.5]
    assert (table["seconds_saved"] > 0.019).all() and not table["noisy"].any()
    # Only what is left out and changes the result is complained about.
    assert caplog.text.count("changes the result by 0.5 rad") == 1


def test_bytes_are_those_of_the_results():
    row = report([leaving(0.0, size=lambda result: result.nbytes)], rounds=2).iloc[0]
    assert (row["bytes_with"], row["bytes_without"], row["bytes_saved"]) == (64, 64, 0)
