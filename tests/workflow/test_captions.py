"""Captions of a run's page and of `snakemake --report`, which read the same files: one for each table and figure."""

import re

import pytest

from palpate.results.captions import FOLDER, caption, position
from tests.workflow.conftest import PROJECT, plan

KINDS = (("tables", "csv"), ("figures", "png"))
DATASET = ["dataset_statistics", "grasp_success", "penetration"]


def test_every_table_and_figure_has_a_caption_of_its_own():
    printed = plan(PROJECT, "--dry-run", "--forceall", "all").stdout
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


def test_names_are_in_the_order_of_their_captions():
    names = ["zzz", "architectures/touch", "claims", "touch_effect_by_class", "touch_effect", "dataset_statistics"]
    ordered = ["dataset_statistics", "claims", "touch_effect", "touch_effect_by_class", "architectures/touch", "zzz"]
    assert sorted(names, key=lambda name: position("tables", name)) == ordered


def test_snakemakes_report_reads_the_same_files():
    rules = "".join(path.read_text() for path in (PROJECT / "workflow/rules").glob("*.smk"))
    stated = re.findall(r'caption="([^"]+)"', rules)
    assert {(PROJECT / "workflow/rules" / path).resolve() for path in stated} == set(FOLDER.glob("*.rst"))
