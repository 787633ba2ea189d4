"""Experiments as grids: their names, what they take from their methods, and the tables that select them."""

from pathlib import Path

import pytest
import yaml

from palpate.configuration import ConfigError
from palpate.experiments import METHODS, Correction, Experiment, Experiments, name_of
from tests.learning.synthetic import EXPERIMENTS

SCHEMA = Path(__file__).parents[1] / "workflow/schemas/experiments.schema.yaml"
CHARTS = {"method": "charts", "vision": "occluded", "touch": True}
ANY = {"method": "template", "touch": True, "grasps": 5, "fewer_grasps": True}


@pytest.fixture
def read(tmp_path):
    """Reads a file of these experiments, and one table."""

    def read(experiments, *selected) -> Experiments:
        tables = {"grasps": {"split": "test", "experiments": [*selected]}} if selected else {}
        path = tmp_path / "experiments.yaml"
        path.write_text(yaml.safe_dump({"experiments": experiments, "tables": tables}, sort_keys=False))
        return Experiments.read(path, SCHEMA)

    return read


@pytest.mark.parametrize(
    ("properties", "name"),
    [
        ({"method": "template", "vision": "unoccluded", "touch": True, "grasps": 5}, "template_unoccluded_touch_5"),
        ({"method": "no_comm", "vision": "unoccluded", "touch": True}, "no_comm_unoccluded_touch"),
        ({"method": "sphere", "vision": "occluded", "touch": False}, "sphere_occluded"),
        ({"method": "template", "vision": "none", "touch": True, "grasps": 2}, "template_touch_2"),
        (ANY | {"vision": "none"}, "template_touch_any"),
        (ANY | {"vision": "occluded"}, "template_occluded_any"),
        ({"method": "charts", "vision": "views", "touch": False}, "single_image"),
        ({"method": "r2n2", "vision": "views", "touch": False}, "single_image_r2n2"),
    ],
)
def test_names_are_made_of_properties(properties, name):
    assert name_of(properties) == name and name in EXPERIMENTS


def test_a_grid_has_every_combination_of_its_lists(read):
    grid = {"method": ["sphere", "charts"], "vision": ["occluded", "unoccluded"], "touch": [True, False]}
    made = read([grid], {"touch": [False, True], "vision": "occluded", "method": ["charts", "sphere"]})
    assert len(made.experiments) == 8
    names = ["charts_occluded", "sphere_occluded", "charts_occluded_touch", "sphere_occluded_touch"]
    assert [*made.tables["grasps"].by_name] == names
    assert made.experiments["sphere_occluded"] == Experiment("sphere_occluded", "sphere", "occluded", False, 1)


def test_a_row_changes_what_its_method_has_and_weights_share_it(read):
    any_number = ANY | {"vision": "occluded"}
    mine = any_number | {"name": "mine", "architecture": {"gcn": {"layers": 3}}, "correction": None}
    of_mine = {"method": "template", "vision": "occluded", "touch": True, "weights": "mine"}
    alone = of_mine | {"touch": False, "weights": {"touch": True, "grasps": 5, "fewer_grasps": True}}
    made = read([any_number, mine, of_mine, alone], "mine").experiments
    assert made["template_occluded_any"].correction == Correction(0.08, 0.3)
    assert made["mine"].correction is made["template_occluded_touch"].correction is None
    assert made["mine"].architecture == made["template_occluded_touch"].architecture == {"gcn": {"layers": 3}}
    assert made["template_occluded"].weights == "template_occluded_any"
    assert made["template_occluded"].correction is None  # it has no touch


@pytest.mark.parametrize(
    ("experiments", "selected", "message"),
    [
        ({"mine": CHARTS}, [], "expected a list of grids"),
        ([CHARTS | {"vision": ["occluded", "dark"]}], [], "'dark' is not one of"),
        (
            [CHARTS | {"architecture": {"gcn": {"widht": 9}}}],
            [],
            "architecture.gcn.widht: unknown key; did you mean 'width'?",
        ),
        (
            [CHARTS | {"architecture": {"gcn": {"width": 2}}}],
            [],
            "architecture.gcn.width: 2 is less than the minimum of 3",
        ),
        ([CHARTS | {"method": "chart"}], [], "method 'chart' is unknown; there are sphere, no_copy"),
        ([CHARTS, CHARTS], [], "two experiments charts_occluded_touch: remove one, or state another `name`"),
        ([CHARTS | {"weights": {"touch": False}}], [], "weights charts_occluded, which is no trained experiment"),
        ([CHARTS | {"weights": {"vision": "none"}}], [], "weights.vision: unknown key"),
        ([CHARTS | {"vision": "none", "touch": [True, False]}], [], "charts: charts can't take as input: nothing"),
        ([CHARTS | {"method": "psg"}], [], "psg can't take as input: occluded vision + touch"),
        (
            [CHARTS | {"method": "retrieval", "vision": "views"}],
            [],
            "can't take as input: single view + touch",
        ),
        (
            [CHARTS],
            ["charts_occluded"],
            "has an experiment with name: charts_occluded, and none is defined",
        ),
        ([CHARTS], [CHARTS | {"grasps": [1, 2]}], "table grasps has an experiment with grasps: 2, and none is defined"),
    ],
)
def test_mistakes_are_named(read, experiments, selected, message):
    with pytest.raises(ConfigError, match=r"experiments\.yaml") as error:
        read(experiments, *selected)
    assert message in str(error.value)


def test_the_papers_number_is_that_of_the_same_inputs():
    stated = {name: EXPERIMENTS[name].stated_as for name in EXPERIMENTS}
    assert stated["template_unoccluded_touch_5"] == "charts_unoccluded_touch_5"
    assert stated["template_occluded"] == stated["retrieval_occluded"] == "charts_occluded"
    assert stated["mean_occluded_touch"] == "charts_occluded_touch" and stated["retrieval_touch_5"] == "charts_touch_5"
    assert {name for name in stated if name == stated[name]} == {
        name for name, experiment in EXPERIMENTS.items() if not experiment.method.stated_as
    }


def test_labels_say_whose_a_row_is():
    rows = [
        Experiment("a", "charts", "occluded", True, 1),
        Experiment("b", "template", "none", True, 2, correction=Correction(0.08, 0.3)),
        Experiment("b", "retrieval", "occluded", False, 1),
        Experiment("c", "psg", "views", False, 1),
        EXPERIMENTS["mean_occluded_touch"],
    ]
    assert [row.method.label for row in rows] == [
        "charts, equation 1 (paper)", "template (ours)",
        "retrieval (no training)", "in the manner of PSG", "charts, mean (authors' first release)",
    ]  # fmt: skip
    assert [row.input_label for row in rows] == [
        "occluded vision + touch",
        "touch",
        "occluded vision",
        "single view",
        "occluded vision + touch",
    ]


def test_methods_name_each_other():
    assert len({method.label for method in METHODS.values()}) == len(METHODS)
    for method in METHODS.values():
        named = [*filter(None, [method.stated_as]), *(method.lacks or ())]
        assert all(METHODS[name].whose == "paper" for name in named)
