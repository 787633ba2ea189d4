import itertools

import numpy as np
import pytest

from palpate.results.statistics import ratio, ratio_interval


def test_the_interval_is_the_normal_approximation_for_many_objects():
    rng = np.random.default_rng(1)
    share = rng.beta(4, 2, size=400)
    touches = np.full(400, 20)
    low, high = ratio_interval(share * touches, touches)
    half = 1.96 * share.std() / np.sqrt(400)
    assert low == pytest.approx(share.mean() - half, abs=0.1 * half)
    assert high == pytest.approx(share.mean() + half, abs=0.1 * half)


def test_the_interval_of_a_ratio_is_the_delta_methods():
    rng = np.random.default_rng(2)
    touches = rng.integers(4, 40, size=500)
    hits = rng.binomial(touches, 0.6)
    low, high = ratio_interval(hits, touches)
    estimate = hits.sum() / touches.sum()
    half = 1.96 * np.sqrt(np.mean((hits - estimate * touches) ** 2) / 500) / touches.mean()
    assert low == pytest.approx(estimate - half, abs=0.15 * half)
    assert high == pytest.approx(estimate + half, abs=0.15 * half)


def test_the_interval_of_three_objects_is_that_of_all_27_resamples():
    hits, touches = np.array([1, 5, 12]), np.array([4, 8, 12])
    exact = np.array(
        [hits[list(draw)].sum() / touches[list(draw)].sum() for draw in itertools.product(range(3), repeat=3)]
    )
    low, high = ratio_interval(hits, touches, level=0.8, resamples=20_000)
    assert low == pytest.approx(np.quantile(exact, 0.1))
    assert high == pytest.approx(np.quantile(exact, 0.9))


def test_objects_are_resampled_within_their_stratum():
    """Two classes that differ much, and little within: the interval is that of the spread within."""
    rng = np.random.default_rng(4)
    share = np.repeat([0.2, 0.8], 200) + rng.normal(0, 0.02, 400)
    low, high = ratio_interval(share, np.ones(400), strata=np.repeat(["a", "b"], 200))
    assert high - low == pytest.approx(2 * 1.96 * 0.02 / 20, rel=0.15)
    low, high = ratio_interval(share, np.ones(400))
    assert high - low == pytest.approx(2 * 1.96 * 0.3 / 20, rel=0.15)


def test_grasps_of_an_object_that_are_alike_do_not_narrow_the_interval():
    share = np.random.default_rng(3).uniform(size=100)
    few = ratio_interval(share * 4, np.full(100, 4))
    many = ratio_interval(share * 4000, np.full(100, 4000))
    assert few == pytest.approx(many)


@pytest.mark.parametrize(
    "hits, touches",
    [([], []), ([3], [4]), ([0, 0], [0, 0]), ([3, 3], [4, 4])],
    ids=["none", "one object", "no touches", "alike"],
)
def test_without_spread_over_objects_there_is_no_interval(hits, touches):
    assert np.isnan(ratio_interval(np.array(hits), np.array(touches))).all()


def test_an_object_without_touches_is_not_an_error():
    low, high = ratio_interval([2, 0, 3], [4, 0, 4])
    assert 0.5 <= low <= high <= 0.75


def test_arrays_of_different_lengths_are_refused():
    with pytest.raises(ValueError, match="3, 2 and 3"):
        ratio_interval([1, 2, 3], [4, 4])


def test_ratio():
    assert ratio([1, 2], [4, 4]) == 3 / 8
    assert np.isnan(ratio([], []))
