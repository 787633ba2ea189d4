"""The rows of omissions."""

import time

import numpy as np

from studies.omitted.omission import (
    COLUMNS,
    DIFFERS,
    NOT_MODELLED,
    OMITTED,
    SAME,
    STAYS,
    Omission,
    report,
    verdict_text,
)


def omission(extra: float, **options) -> Omission:
    def with_it():
        time.sleep(0.02)
        return np.arange(8.0) + extra

    return Omission(
        stage="grasp",
        item="gravity",
        when="always",
        object="bottle-0000",
        with_it=with_it,
        without=lambda: np.arange(8.0),
        difference=lambda one, other: np.abs(one - other).max(),
        unit="rad",
        **options,
    )


def test_same_within_the_bound_and_what_it_saves(caplog):
    table = report([omission(0.0), omission(0.5), omission(0.5, bound=0.5), omission(0.5, state=STAYS)], rounds=5)
    assert tuple(table.columns) == COLUMNS
    assert table["verdict"].tolist() == [SAME, DIFFERS, SAME, DIFFERS]
    assert table["difference"].tolist() == [0, 0.5, 0.5, 0.5]
    assert (table["seconds_saved"] > 0.019).all() and not table["noisy"].any()
    assert table["omitted"].tolist() == [True, True, True, False]
    # The log warns only of what is omitted and changes the result.
    assert caplog.text.count("changes the result by 0.5 rad") == 1


def test_bytes_are_those_of_the_results():
    row = report([omission(0.0, size=lambda result: result.nbytes)], rounds=2).iloc[0]
    assert (row["bytes_with"], row["bytes_without"], row["bytes_saved"]) == (64, 64, 0)


def test_words_name_the_state_of_what_is_not_omitted():
    assert verdict_text(True, OMITTED) == SAME and verdict_text(False, OMITTED) == DIFFERS
    assert verdict_text(True, STAYS) == "same, stays" and verdict_text(False, NOT_MODELLED) == "differs, not modelled"
