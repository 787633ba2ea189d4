"""The paper's numbers were typed in by hand: they must agree with each other, and with what the text says."""

import pandas as pd
import pytest

from palpate.experiments import METHODS, SPLITS, Comparison, Experiment
from palpate.results.claims import decide, touch_effect
from palpate.results.products import needed_splits
from palpate.results.published import exchanged, paper_values, published_experiments, terms
from tests.learning import synthetic
from tests.learning.synthetic import DECLARED

CLASSES = ["bottle", "knife", "cellphone", "rifle"]


def test_averages_are_those_of_the_classes():
    table = paper_values("model_selection").pivot(index="row", columns="class", values="value")
    assert len(table) == 12
    assert (table[CLASSES].mean(axis=1) - table["average"]).abs().max() < 0.00051
    local = paper_values("local_touch_charts").set_index("class")["value"]
    assert local[CLASSES].mean() == pytest.approx(local["average"])


def test_tables_agree_where_they_state_the_same():
    modalities = paper_values("input_modalities").set_index("experiment")["value"]
    grasps = paper_values("grasps").set_index("experiment")["value"]
    for name in ("charts_unoccluded_touch", "charts_touch"):
        assert grasps[name] == modalities[name]
    # Section 5.3: "smallest average global error of 0.804"; section 5.1: 3.050, and 1.074 the next worse.
    assert modalities.min() == 0.804 and modalities.sort_values().iloc[-2:].tolist() == [1.074, 3.05]


def test_rings_times_9000_are_of_the_main_tables_size():
    rings = 9000 * paper_values("extrapolation")["value"]
    assert rings.between(0.1, 1).all() and len(rings) == 20


def test_every_published_experiment_is_declared_in_its_table():
    for table in ("model_selection", "input_modalities", "grasps", "extrapolation"):
        published = published_experiments(table)
        assert published == [name for name in DECLARED.tables[table].by_name if name in published]
    grasps = paper_values("grasps")
    assert (grasps["experiment"].map(lambda n: DECLARED.experiments[n].grasps) == grasps["grasps"]).all()


def test_the_single_image_table_marks_what_is_cited():
    table = paper_values("single_image").set_index("method")
    assert (table["cited_by_the_paper"] == "no").sum() == 1
    assert table.loc["Smith et al. (charts)"].tolist()[1:4] == [0.369, 69.52, 82.33]
    both = table.dropna()
    assert (both["f1_tau"] < both["f1_2tau"]).all()


def test_every_row_says_where_it_stands():
    for name in ("model_selection", "input_modalities", "local_touch_charts", "grasps", "extrapolation"):
        assert paper_values(name)["source"].str.contains("Table").all() and "unit" in paper_values(name)


def test_tables_claims_and_differences_are_the_same_from_the_splits_that_are_needed():
    means = synthetic.published_means()
    measured = synthetic.evaluations(means, each=3)
    needed = {name: needed_splits(DECLARED.experiments[name], DECLARED.tables) for name in means}
    kept = [row.split in needed[row.experiment] for row in measured.itertuples()]
    of_needed = measured[kept]
    assert 0 < len(of_needed) < len(measured)
    rings, touches = synthetic.rings(synthetic.published_rings(), each=3), synthetic.touches(0.01, each=3)
    for make in (lambda rows: decide(rows, rings, touches, resamples=50), lambda rows: touch_effect(rows, 50)):
        pd.testing.assert_frame_equal(make(of_needed), make(measured))
    for name, table in DECLARED.tables.items():
        for experiment in table.by_name.values():
            assert table.split in needed_splits(experiment, DECLARED.tables), name


@pytest.mark.parametrize(
    ("experiment", "tables", "splits"),
    [
        ("single_image", {"single_image": "test"}, ["test"]),
        ("single_image", {"single_image": "validation"}, ["validation"]),
        ("charts_touch_3", {"grasps": "validation"}, SPLITS),  # a claim's
        ("charts_touch_3", {}, ["test"]),
        ("sphere_occluded", {}, SPLITS),  # a difference's
        ("my_own", {}, SPLITS),
    ],
)
def test_a_split_is_needed_by_a_table_a_claim_or_a_difference(experiment, tables, splits):
    made = Experiment(experiment, strategy="charts", vision="none", touch=True, grasps=1)
    declared = {name: Comparison(name, split, {made.name: made}) for name, split in tables.items()}
    assert needed_splits(made, declared) == list(splits)


KNOWN = ("charts_occluded", "charts_occluded_touch", "mean_occluded_touch", "template_occluded_touch", "cloud")
KNOWN += ("template_unoccluded", "sphere_occluded_touch", "retrieval_occluded_touch")
BOTH = "charts occluded_touch; no_comm occluded_touch"


@pytest.mark.parametrize(
    ("papers", "method", "own"),
    [
        ("charts occluded_touch; charts occluded", "charts", "charts occluded_touch; charts occluded"),
        (BOTH, "charts", BOTH),
        ("charts occluded_touch x1; cloud", "template", "template occluded_touch x1; cloud"),
        ("charts occluded_touch; charts occluded", "template", "template occluded_touch; charts occluded"),
        (BOTH, "template", None),  # of no other use than the charts'
        (BOTH, "mean", "mean occluded_touch; no_comm occluded_touch"),
        ("charts occluded_touch; no_copy occluded_touch", "mean", None),
        ("charts occluded; charts occluded", "template", None),  # the same as the paper's
        ("sphere occluded_touch", "template", None),  # the same, too
        ("charts touch", "template", None),  # not known
        ("charts unoccluded", "template", "template unoccluded"),
        ("charts occluded_touch x2", "template", "template occluded_touch x2"),
        (
            "charts occluded_touch; sphere occluded_touch; charts unoccluded",
            "template",
            "template occluded_touch; sphere occluded_touch; template unoccluded",
        ),
        ("charts occluded_touch", "retrieval", None),  # nothing is claimed of it
    ],
)
def test_experiments_are_exchanged_whole_or_not(papers, method, own):
    assert exchanged(terms(papers), METHODS[method], KNOWN) == (own and terms(own))


def test_terms_are_called_as_their_errors():
    assert [term.key for term in terms("charts occluded x1; cloud")] == ["charts_occluded x1", "cloud"]
    assert [term.experiment for term in terms("no_copy occluded_touch x1; cloud")] == ["no_copy_occluded_touch", ""]
