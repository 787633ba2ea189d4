import numpy as np
import pytest
from scipy import stats

from palpate.results.bootstrap import Estimate, between_seeds, interval, ratio_interval

FOUR = np.repeat(["bottle", "knife", "cellphone", "rifle"], 6)


def difference(means):
    return means[..., 0] - means[..., 1]


def test_the_average_is_that_of_the_class_means():
    """The paper's row 1: (0.775 + 0.572 + 1.262 + 0.643) / 4 = 0.813, whatever the number of objects."""
    classes = np.array(["bottle"] * 3 + ["knife"] * 2 + ["cellphone"] * 2 + ["rifle"] * 5)
    means = {"bottle": 0.775, "knife": 0.572, "cellphone": 1.262, "rifle": 0.643}
    values = np.array([[means[name] for name in classes]] * 2)
    values[0] += 0.1
    values[1] -= 0.1  # seeds are averaged
    assert interval([values], classes).value == pytest.approx(0.813)


def test_of_one_class_it_is_students_interval():
    """For normal errors and one seed: mean, t and standard error."""
    rng = np.random.default_rng(0)
    for count in (2, 4, 8, 30):
        errors = rng.normal(2, 0.5, count)
        found = interval([errors[None]], np.zeros(count), resamples=20_000)
        low, high = stats.t.interval(0.95, count - 1, errors.mean(), stats.sem(errors))
        assert [found.low, found.high] == pytest.approx([low, high], abs=0.015 * (high - low))


def test_of_many_objects_it_is_scipys():
    rng = np.random.default_rng(1)
    errors = rng.exponential(1, 300)
    found = interval([errors[None]], np.zeros(300), resamples=10_000)
    theirs = stats.bootstrap(
        (errors,), np.mean, n_resamples=10_000, method="percentile", random_state=np.random.default_rng(2)
    ).confidence_interval
    assert [found.low, found.high] == pytest.approx([theirs.low, theirs.high], abs=0.02)


@pytest.mark.parametrize(
    ("seeds", "each", "seed_spread", "bounds"),
    [
        (1, 4, 0.0, (0.91, 0.98)),
        (1, 10, 0.0, (0.91, 0.98)),
        (3, 10, 0.3, (0.92, 0.99)),
        (2, 10, 0.5, (0.92, 0.99)),
    ],
)
def test_the_true_difference_is_inside_in_about_95_of_100_runs(seeds, each, seed_spread, bounds):
    """Two models, paired by object; objects are hard in common, seeds shift a model as a whole."""
    rng = np.random.default_rng(3)
    classes = np.repeat(np.arange(4), each)
    inside = 0
    runs = 300
    for run in range(runs):
        hard = rng.normal(0, 1, 4 * each)

        def model(mean, hard=hard):
            own = rng.normal(0, 0.2, 4 * each)
            return mean + hard + own + rng.normal(0, seed_spread, (seeds, 1))

        found = interval([model(1.0), model(0.7)], classes, difference, resamples=500, seed=run)
        inside += found.low <= 0.3 <= found.high
    assert bounds[0] <= inside / runs <= bounds[1]


@pytest.mark.parametrize(("seeds", "each", "own_spread"), [(1, 10, 0.0), (2, 10, 0.1), (3, 5, 0.02), (3, 20, 0.1)])
def test_continuations_of_one_base_are_compared_within_its_seed(seeds, each, own_spread):
    """Models that start from the base of their seed: its shift, far larger than the difference, cancels; the interval
    contains the truth in about 95 of 100 runs, and its width is that of the spreads that remain."""
    rng = np.random.default_rng(11)
    classes = np.repeat(np.arange(4), each)
    runs, inside, errors, variances = 300, 0, [], []
    for run in range(runs):
        base = rng.normal(0, 1, 4 * each) + rng.normal(0, 1, (seeds, 1))

        def model(mean, base=base):
            return mean + base + rng.normal(0, 0.2, 4 * each) + rng.normal(0, own_spread, (seeds, 1))

        found = interval([model(1.0), model(0.9)], classes, difference, resamples=400, seed=run)
        inside += found.low <= 0.1 <= found.high
        errors.append(found.value - 0.1)
        variances.append((found.high - found.low) ** 2 / 4)
    assert 0.92 <= inside / runs <= 0.99
    known = 2 * 0.2**2 / (4 * each) + 2 * own_spread**2 / seeds  # of the difference; the shift of 1 is not in it
    assert np.mean(np.square(errors)) == pytest.approx(known, rel=0.3)
    assert np.mean(variances) > 1.96**2 * known * 0.9


def test_the_variance_of_a_difference_is_that_of_its_seeds_and_objects():
    """Many seeds and objects, where Student's factor is the normal one: by the formula in the docstring."""
    rng = np.random.default_rng(8)
    seeds, objects = 40, 400
    a, b, e = rng.normal(0, 0.1, (seeds, 1)), rng.normal(0, 0.5, objects), rng.normal(0, 1.0, (seeds, objects))
    found = interval([a + b + e, np.zeros((seeds, objects))], np.zeros(objects), difference, resamples=4000)
    known = a.var() / seeds + b.var() / objects + 3 * e.var() / (seeds * objects)
    assert ((found.high - found.low) / 2 / 1.99) ** 2 == pytest.approx(known, rel=0.12)


def test_two_seeds_differ_by_the_mean_over_all_pairs():
    """By a loop over pairs, of the class average, of a difference, and where one experiment has a single seed."""
    rng = np.random.default_rng(9)
    classes = np.array(["a"] * 5 + ["b"] * 3)
    one, other, fixed = rng.normal(1, 1, (4, 8)), rng.normal(2, 1, (4, 8)), rng.normal(0, 1, (1, 8))

    def average(row):
        return (row[:5].mean() + row[5:].mean()) / 2

    def pairs(numbers):
        return np.mean([abs(numbers[i] - numbers[j]) for i in range(4) for j in range(i)])

    assert between_seeds([one], classes) == pytest.approx(pairs([average(row) for row in one]))
    differences = [average(a) - average(b) for a, b in zip(one, other, strict=True)]
    assert between_seeds([one, other], classes, difference) == pytest.approx(pairs(differences))
    assert between_seeds([one, fixed], classes, difference) == pytest.approx(pairs([average(row) for row in one]))
    assert np.isnan(between_seeds([fixed], classes))


def test_pairing_takes_out_what_objects_have_in_common():
    rng = np.random.default_rng(4)
    hard = rng.normal(0, 1, 24)
    one, other = hard + rng.normal(0, 0.01, 24), hard + 0.1 + rng.normal(0, 0.01, 24)
    paired = interval([one[None], other[None]], FOUR, difference)
    alone = interval([one[None]], FOUR)
    assert paired.high - paired.low < 0.05 * (alone.high - alone.low)
    assert paired.high < 0


def test_few_seeds_widen_the_interval_as_student_says():
    """Objects alike, seeds apart: Student's interval of k seeds' means."""
    shifts = np.array([[0.1], [0.3], [0.5], [0.35]])
    found = interval([shifts + np.zeros(24)], FOUR, resamples=20_000)
    low, high = stats.t.interval(0.95, 3, shifts.mean(), stats.sem(shifts.ravel()))
    assert [found.low, found.high] == pytest.approx([low, high], abs=0.015 * (high - low))
    one = interval([shifts[:1] + np.zeros(24)], FOUR)
    assert one == (pytest.approx(0.1),) * 3


def test_a_class_with_one_object_has_no_interval():
    found = interval([np.array([[1.0, 2.0, 3.0]])], np.array(["a", "a", "b"]))
    assert found.value == 2.25 and np.isnan([found.low, found.high]).all()


def test_what_does_not_vary_has_an_interval_without_width():
    assert interval([np.full((1, 24), 0.5)], FOUR) == (pytest.approx(0.5),) * 3


def test_the_same_numbers_give_the_same_interval():
    values = np.random.default_rng(6).normal(1, 0.2, (2, 24))
    assert interval([values], FOUR) == interval([values.copy()], FOUR)


@pytest.mark.parametrize(
    ("values", "classes"),
    [
        ([np.zeros((1, 3))], np.zeros(4)),
        ([np.zeros((0, 4))], np.zeros(4)),
        ([np.zeros((1, 0))], np.zeros(0)),
        ([], np.zeros(4)),
        ([np.array([[1.0, np.nan]])], np.zeros(2)),
        ([np.zeros((2, 4)), np.zeros((3, 4))], np.zeros(4)),
    ],
)
def test_arrays_that_do_not_fit_are_errors(values, classes):
    with pytest.raises(ValueError, match="expected|finite"):
        interval(values, classes)


def test_the_interval_of_a_ratio_is_the_delta_methods():
    """Objects count by their touches: the value is of the sums."""
    rng = np.random.default_rng(2)
    touches = rng.integers(4, 40, size=500)
    hits = rng.binomial(touches, 0.6)
    classes = np.repeat(["a", "b"], [100, 400])
    found = ratio_interval(hits, touches, classes)
    assert found.value == hits.sum() / touches.sum()
    half = 1.96 * np.sqrt(np.mean((hits - found.value * touches) ** 2) / 500) / touches.mean()
    assert found.low == pytest.approx(found.value - half, abs=0.15 * half)
    assert found.high == pytest.approx(found.value + half, abs=0.15 * half)


def test_objects_of_a_ratio_are_resampled_within_their_class():
    """Two classes that differ much, and little within: the interval is that of the spread within."""
    rng = np.random.default_rng(4)
    share = np.repeat([0.2, 0.8], 200) + rng.normal(0, 0.02, 400)
    within = ratio_interval(share, np.ones(400), np.repeat(["a", "b"], 200))
    assert within.high - within.low == pytest.approx(2 * 1.96 * 0.02 / 20, rel=0.15)
    together = ratio_interval(share, np.ones(400), np.zeros(400))
    assert together.high - together.low == pytest.approx(2 * 1.96 * 0.3 / 20, rel=0.15)


def test_grasps_of_an_object_that_are_alike_do_not_narrow_the_interval():
    share = np.random.default_rng(3).uniform(size=100)
    few = ratio_interval(share * 4, np.full(100, 4), np.zeros(100))
    many = ratio_interval(share * 4000, np.full(100, 4000), np.zeros(100))
    assert few == pytest.approx(many)


@pytest.mark.parametrize(
    ("hits", "touches", "value"),
    [([], [], np.nan), ([3], [4], 0.75), ([0, 0], [0, 0], np.nan), ([3, 3], [4, 4], 0.75)],
    ids=["none", "one object", "no touches", "alike"],
)
def test_a_ratio_without_spread_over_objects_has_no_interval(hits, touches, value):
    found = ratio_interval(np.array(hits), np.array(touches), np.zeros(len(hits)))
    assert found.value == pytest.approx(value, nan_ok=True) and np.isnan([found.low, found.high]).all()


def test_an_object_without_touches_is_not_an_error():
    found = ratio_interval([2, 0, 3], [4, 0, 4], np.zeros(3))
    assert found.low < found.value == 0.625 < found.high


def test_a_ratio_of_arrays_of_different_lengths_is_refused():
    with pytest.raises(ValueError, match="3|2"):
        ratio_interval([1, 2, 3], [4, 4], np.zeros(3))


def test_an_interval_is_cut_to_what_a_number_can_be():
    found = Estimate(0.9, 0.7, 1.1)
    assert found.within(0, 1) == (0.9, 0.7, 1.0) and found.within(0) == found
    assert np.isnan(Estimate(0.5, np.nan, np.nan).within(0, 1).low)


def test_a_ratio_is_measured_with_its_own_interval():
    """By the delta method: the spread of a ratio of two means."""
    rng = np.random.default_rng(5)
    one, other = rng.normal(1, 0.1, 200), rng.normal(2, 0.1, 200)
    found = interval(
        [one[None], other[None]], np.zeros(200), lambda means: means[..., 0] / means[..., 1], resamples=10_000
    )
    residual = (one - found.value * other) / other.mean()
    assert found.value == pytest.approx(one.mean() / other.mean())
    assert found.high - found.low == pytest.approx(2 * 1.97 * stats.sem(residual), rel=0.05)


def test_the_interval_of_a_share_is_the_normal_approximation_for_many_objects():
    rng = np.random.default_rng(1)
    share = rng.beta(4, 2, size=400)
    touches = np.full(400, 20)
    found = ratio_interval(share * touches, touches, np.zeros(400))
    half = 1.96 * share.std() / np.sqrt(400)
    assert found.value == pytest.approx(share.mean())
    assert found.low == pytest.approx(share.mean() - half, abs=0.1 * half)
    assert found.high == pytest.approx(share.mean() + half, abs=0.1 * half)
