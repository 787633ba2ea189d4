"""Captions of `snakemake --report`: one for each table and figure."""

from types import SimpleNamespace

import jinja2
import pytest

from tests.evaluation.synthetic import DECLARED
from tests.workflow.conftest import PROJECT

DATASET = ["dataset_statistics", "grasp_success", "penetration"]
MODELS = [*DECLARED["tables"], "local_touch_charts", "claims", "tuning", "architectures/occluded"]
FIGURES = ["data_point", "grasp_steps", "examples_mug", "multi_grasp", "error_over_rings", "training_curves"]
FIGURES += ["reconstructions", "local_predictions", "atlas"]


def caption(kind: str, **wildcards: str) -> str:
    template = jinja2.Template((PROJECT / f"workflow/report/{kind}.rst").read_text())
    return template.render(snakemake=SimpleNamespace(wildcards=SimpleNamespace(**wildcards))).strip()


def test_every_table_and_figure_has_a_caption_of_its_own():
    tables = {name: caption("tables", table=name) for name in [*DATASET, *MODELS]}
    figures = {name: caption("figures", figure=name) for name in FIGURES}
    captions = [*tables.values(), *figures.values()]
    assert all(len(text) > 80 for text in captions) and len(set(captions)) == len(captions)
    assert "of class mug," in figures["examples_mug"]
    assert "twelve models" in tables["model_selection"] and "hold the paper's values" in tables["model_selection"]


@pytest.mark.parametrize("name", DATASET)
def test_captions_of_the_dataset_say_nothing_of_seeds(name):
    assert "seeds" not in caption("tables", table=name)
