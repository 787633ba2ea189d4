"""Captions of `snakemake --report`: one for each table and figure."""

import re
from types import SimpleNamespace

import jinja2
import pytest

from tests.workflow.conftest import PROJECT, plan

KINDS = (("tables", "csv"), ("figures", "png"))
DATASET = ["dataset_statistics", "grasp_success", "penetration"]


def caption(kind: str, **wildcards: str) -> str:
    template = jinja2.Template((PROJECT / f"workflow/report/{kind}.rst").read_text())
    return template.render(snakemake=SimpleNamespace(wildcards=SimpleNamespace(**wildcards))).strip()


def test_every_table_and_figure_has_a_caption_of_its_own():
    printed = plan(PROJECT, "--dry-run", "--forceall", "all").stdout
    tables, figures = (set(re.findall(rf"{kind}/(\S+?)\.{form}", printed)) for kind, form in KINDS)
    assert {"dataset_statistics", "touch_effect", "claims", "architectures/touch"} <= tables and "atlas" in figures
    captions = {name: caption("tables", table=name) for name in [*tables, "tuning"]}
    captions |= {name: caption("figures", figure=name) for name in figures}
    # The layers of all models share a caption, and the examples of all classes but for the class.
    assert all(len(text) > 80 for text in captions.values()), [name for name in captions if len(captions[name]) <= 80]
    own = [text for name, text in captions.items() if not name.startswith("architectures/")]
    assert len({*own, captions["architectures/touch"]}) == len(own) + 1
    assert "of class bottle," in captions["examples_bottle"]
    assert "twelve models" in captions["model_selection"] and "hold the paper's values" in captions["model_selection"]


@pytest.mark.parametrize("name", DATASET)
def test_captions_of_the_dataset_say_nothing_of_seeds(name):
    assert "seeds" not in caption("tables", table=name)
