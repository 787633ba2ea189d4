"""The front against the definition, pair by pair."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from studies.error_vs_runtime.study import front

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
