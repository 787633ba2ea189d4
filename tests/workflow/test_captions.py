"""Tables and figures as the workflow takes them from their functions: captions and order."""

import re

import pytest

from palpate.results.products import caption, position
from tests.workflow.conftest import PROJECT, run_snakemake

KINDS = (("tables", "csv"), ("figures", "png"))
DATASET = ["dataset_statistics", "grasp_success"]


def test_every_table_and_figure_has_a_caption_of_its_own():
    printed = run_snakemake(PROJECT, "--dry-run", "--forceall", "all").stdout
    tables, figures = (set(re.findall(rf"{kind}/(\S+?)\.{form}", printed)) for kind, form in KINDS)
    assert {"dataset_statistics", "touch_effect", "claims", "architectures/touch"} <= tables and "atlas" in figures
    captions = {name: caption("tables", name) for name in [*tables, "tuning"]}
    captions |= {name: caption("figures", name) for name in figures}
    # The layers of all models share a caption, and the examples of all classes but for the class.
    assert all(len(text) > 80 for text in captions.values()), [name for name in captions if len(captions[name]) <= 80]
    own = [text for name, text in captions.items() if not name.startswith("architectures/")]
    assert len({*own, captions["architectures/touch"]}) == len(own) + 1
    assert "of class bottle," in captions["examples_bottle"]
    assert "twelve models" in captions["model_selection"] and "hold the paper's values" in captions["model_selection"]


@pytest.mark.parametrize("name", DATASET)
def test_captions_of_the_dataset_say_nothing_of_seeds(name):
    assert "seeds" not in caption("tables", name)


def test_names_are_in_the_order_of_their_products():
    names = ["zzz", "architectures/touch", "claims", "touch_effect_by_class", "touch_effect", "dataset_statistics"]
    dataset_first, *others = sorted(names, key=lambda name: position("tables", name))
    assert dataset_first == "dataset_statistics" and others[-1] == "zzz"
    assert others.index("touch_effect") + 1 == others.index("touch_effect_by_class")  # as they stand in their module


def test_snakemakes_report_has_the_docstrings(finished, tmp_path):
    path = tmp_path / "report.html"
    result = finished("tables/dataset_statistics.csv", "figures/examples_can.png", "--report", str(path))
    assert result.returncode == 0, result.stderr
    report = path.read_text()
    # In its HTML: code between tags.
    assert "Size of the dataset by class and in total, how many objects each split has" in report
    assert re.search(r">successful_low<|\\u003esuccessful_low\\u003c", report) and "Examples of class can," in report
