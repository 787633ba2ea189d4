"""Seeds needed: against simulated intervals, and spreads against loops."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import ttest_1samp

from palpate.results.errors import errors
from studies.seeds_needed import MOST, seeds_needed, spreads, table

PAIR = ["charts_occluded_touch", "charts_occluded"]


def rows(split="validation"):
    random, made = np.random.default_rng(0), []
    for seed in range(3):
        for number in range(7):
            name = "bottle" if number < 3 else "knife"
            for experiment in PAIR:
                made.append((experiment, seed, f"{name}-{number}", name, split, 0, random.uniform(1, 2), 100))
    return pd.DataFrame(made, columns=["experiment", "seed", "object", "class", "split", "window", "chamfer", "steps"])


def test_spreads_by_loops():
    frame = rows()
    error = {(row.experiment, row.seed, row.object): row.chamfer for row in frame.itertuples()}
    names = {name: sorted({each for each in frame.object if each.startswith(name)}) for name in ("bottle", "knife")}

    def apart(seed, each):
        return error[PAIR[0], seed, each] - error[PAIR[1], seed, each]

    by_seed = [np.mean([np.mean([apart(s, each) for each in of]) for of in names.values()]) for s in range(3)]
    variances = [
        np.var([np.mean([apart(s, each) for s in range(3)]) for each in of], ddof=1) / len(of) for of in names.values()
    ]
    value, between_seeds, between_objects = spreads(errors(frame, PAIR, "validation"), *PAIR)
    assert value == pytest.approx(np.mean(by_seed)) and between_seeds == pytest.approx(np.std(by_seed, ddof=1))
    assert between_objects == pytest.approx(sum(variances) ** 0.5 / 2)


@pytest.mark.parametrize("effect", [0.5, 1.0, 2.0])
def test_of_so_many_seeds_a_t_test_decides_and_of_fewer_it_does_not(effect):
    count = seeds_needed(effect, 1.0, 0.0)
    for number, decided in ((count, True), (count - 1, False)):
        values = np.resize([-1.0, 1.0], number) if number % 2 == 0 else np.r_[np.resize([-1.0, 1.0], number - 1), 0.0]
        values = effect + values / values.std(ddof=1)  # of standard deviation 1
        assert (ttest_1samp(values, 0).pvalue < 0.05) == decided


def test_what_objects_leave_undecided_no_seed_decides():
    assert seeds_needed(0.19, 0.01, 0.1) is None
    assert seeds_needed(0.21, 0.0, 0.1) <= MOST and seeds_needed(-0.21, 0.0, 0.1) == seeds_needed(0.21, 0.0, 0.1)


def test_the_table_has_the_papers_differences_of_what_was_measured():
    found = table(pd.concat([rows(), rows("test")]))
    assert found["difference"].tolist() == ["Touch beside occluded vision, charts"] * 2
    assert found.split.tolist() == ["validation", "test"]
    assert found["the paper's"].tolist() == pytest.approx([-0.144, -0.083])
