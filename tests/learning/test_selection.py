"""Choices of grasps against brute force and against places where the answer is plain."""

import itertools
from functools import partial

import numpy as np
import pytest

from palpate.experiments import Correction
from palpate.learning.selection import choose, farthest, least_error, most_uncertain

LINE = np.zeros((5, 1, 3))
LINE[:, 0, 0] = [0.0, 0.1, 0.22, 0.6, 1.0]  # m, one site a grasp
UNCERTAIN = partial(most_uncertain, LINE, Correction(0.1, 0.1))


def chosen_by(scores, first=(0,), count=5) -> tuple[int, ...]:
    return list(choose(scores, first, count))[-1]


def test_each_choice_adds_one_grasp_that_was_left():
    rng = np.random.default_rng(0)
    choices = list(choose(lambda chosen: rng.normal(size=7), (), 7))
    assert [len(chosen) for chosen in choices] == list(range(8)) and sorted(choices[-1]) == list(range(7))
    assert all(later[:-1] == before for before, later in itertools.pairwise(choices))


def test_of_equal_scores_the_first_is_taken():
    assert chosen_by(lambda chosen: np.zeros(4), (2,), 4) == (2, 0, 1, 3)
    assert chosen_by(partial(farthest, LINE), (), 1) == chosen_by(UNCERTAIN, (), 1) == (0,)


def test_the_farthest_site_is_next():
    # From 0 the farthest is 1.0; of the others 0.6 is 0.4 away, then 0.22 (0.22), then 0.1.
    assert chosen_by(partial(farthest, LINE)) == (0, 4, 3, 2, 1)


def test_farthest_is_that_of_brute_force():
    sites = np.random.default_rng(1).normal(size=(9, 4, 3))
    for chosen in ((0,), (3, 1), (5, 2, 8)):
        expected = [
            np.mean([min(np.linalg.norm(site - sites[g, s]) for g in chosen for s in range(4)) for site in grasp])
            for grasp in sites
        ]
        np.testing.assert_allclose(farthest(sites, chosen), expected)


def test_uncertainty_is_the_posterior_variance_of_a_dense_solve():
    sites, length, noise = np.random.default_rng(2).normal(0, 0.1, size=(6, 2, 3)), 0.08, 0.3
    chosen = (4, 1)
    known, every = sites[list(chosen)].reshape(-1, 3), sites.reshape(-1, 3)

    def covariance(one, other):
        return np.exp(-np.linalg.norm(one[:, None] - other[None], axis=2) / length)

    inverse = np.linalg.inv(covariance(known, known) + noise * np.eye(len(known)))
    across = covariance(every, known)
    variance = 1 - np.einsum("ij,jk,ik->i", across, inverse, across)
    found = most_uncertain(sites, Correction(length, noise), chosen)
    np.testing.assert_allclose(found, variance.reshape(6, 2).mean(axis=1), rtol=1e-9)


def test_what_was_touched_is_least_uncertain_and_what_is_far_most():
    scores = most_uncertain(LINE, Correction(0.08, 0.01), (0,))
    assert np.argmin(scores) == 0 and np.argmax(scores) == 4 and (np.diff(scores) > 0).all()


def test_the_oracle_takes_the_least_error_each_time():
    """Greedy, against all choices of one more."""
    value = np.random.default_rng(3).normal(size=(6, 6))

    def error(chosen):
        return sum(value[a, b] for a, b in itertools.product(chosen, repeat=2))

    found = chosen_by(partial(least_error, lambda choices: list(map(error, choices)), 6), (), 4)
    expected = ()
    for _ in range(4):
        expected = min(((*expected, k) for k in range(6) if k not in expected), key=error)
    assert found == expected


@pytest.mark.parametrize("scores", [partial(farthest, LINE), UNCERTAIN])
def test_scores_do_not_depend_on_the_order_of_choice(scores):
    np.testing.assert_allclose(scores((0, 3)), scores((3, 0)))
