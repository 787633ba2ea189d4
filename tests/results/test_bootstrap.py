import numpy as np
import pytest
from scipy import stats

from palpate.results.bootstrap import interval

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
    ],
)
def test_arrays_that_do_not_fit_are_errors(values, classes):
    with pytest.raises(ValueError, match="expected|finite"):
        interval(values, classes)
