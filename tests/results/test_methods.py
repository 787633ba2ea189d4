"""Names and labels of methods, against names written out."""

import pytest

from palpate.experiments import Correction, Experiment
from palpate.results.methods import EXCHANGED, NAMES, STATED, exchanged, input_label, label, stated_as
from tests.evaluation.synthetic import EXPERIMENTS


@pytest.mark.parametrize(
    ("name", "paper"),
    [
        ("pooled_unoccluded_touch_5", "charts_unoccluded_touch_5"),
        ("pooled_no_copy_occluded_touch", "no_copy_occluded_touch"),
        ("template_occluded", "charts_occluded"),
        ("retrieval_touch_5", "charts_touch_5"),
        ("no_comm_occluded_touch", "no_comm_occluded_touch"),
        ("sphere_unoccluded", "sphere_unoccluded"),
        ("single_image", "single_image"),
        ("cloud", "cloud"),
    ],
)
def test_the_papers_number_is_that_of_the_same_inputs(name, paper):
    assert stated_as(name) == paper


KNOWN = ("charts_occluded", "charts_occluded_touch", "pooled_occluded_touch", "template_occluded_touch", "cloud")
KNOWN += ("pooled_unoccluded", "sphere_occluded_touch")


@pytest.mark.parametrize(
    ("names", "method", "found"),
    [
        (["charts_occluded_touch", "charts_occluded"], "charts", ("charts_occluded_touch", "charts_occluded")),
        (["charts_occluded_touch x1", "cloud"], "pooled", ("pooled_occluded_touch x1", "cloud")),
        (["charts_occluded_touch", "charts_occluded"], "pooled", ("pooled_occluded_touch", "charts_occluded")),
        (["charts_occluded_touch", "no_comm_occluded_touch"], "template", None),  # of no other use than the charts'
        (["charts_occluded", "charts_occluded"], "pooled", None),  # the same as the paper's
        (["charts_touch"], "pooled", None),  # not known
        (["charts_unoccluded"], "pooled", ("pooled_unoccluded",)),
        (["charts_occluded_touch x2"], "pooled", ("pooled_occluded_touch x2",)),
        (
            ["charts_occluded_touch", "sphere_occluded_touch", "charts_unoccluded"],
            "pooled",
            ("pooled_occluded_touch", "sphere_occluded_touch", "pooled_unoccluded"),
        ),
        (["pooled_occluded_touch", "charts_occluded_touch"], "template", None),  # compares methods already
    ],
)
def test_experiments_are_exchanged_whole_or_not(names, method, found):
    assert exchanged(names, method, KNOWN) == found


def test_labels_say_whose_a_row_is():
    rows = [
        Experiment("a", "charts", "occluded", True, 1),
        Experiment("b", "pooled", "none", True, 2, correction=Correction(0.08, 0.3)),
        Experiment("b", "retrieval", "occluded", False, 1),
        Experiment("c", "psg", "views", False, 1),
        EXPERIMENTS["mean_occluded_touch"],
    ]
    assert [label(row) for row in rows] == [
        "charts, equation 1 (paper)", "pooled touch (ours)",
        "retrieval (no training)", "in the manner of PSG", "charts, mean (authors' first release)",
    ]  # fmt: skip
    assert [input_label(row) for row in rows] == [
        "occluded vision + touch",
        "touch",
        "occluded vision",
        "single view",
        "occluded vision + touch",
    ]
    assert len({*NAMES.values()}) == len(NAMES)
    assert {*EXCHANGED} | {*STATED} | {*STATED.values()} <= {*NAMES}
