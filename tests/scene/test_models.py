"""Plans of experiments: every row of config/experiments.yaml against what its model reads."""

from pathlib import Path

import pytest
import yaml

from palpate.models import Reconstruction
from palpate.scene import plan
from palpate.scene.models import SCENES
from palpate.training import families
from palpate.training.checkpoints import build
from tests.training.conftest import ARCHITECTURE

EXPERIMENTS = yaml.safe_load(Path("config/experiments.yaml").read_text())["experiments"]


def model_of(experiment, plan=None) -> Reconstruction:
    return build(experiment, ARCHITECTURE, plan)


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_what_is_needed_is_what_the_model_reads(name):
    experiment = EXPERIMENTS[name]
    found, model = plan("experiment", **experiment), model_of(experiment)
    reads = set(model._shapes({}))
    assert found.needs("image encoder") == hasattr(model, "encoder") == ("image" in reads)
    assert found.needs("reading encoder") == hasattr(model, "reading_encoder") == ("reading" in reads)
    assert found.needs("touch charts") == ("charts" in reads)
    assert found.needs("touch") == ("success" in reads)
    renders = [part for part in ("unoccluded renders", "occluded renders", "views") if found.needs(part)]
    assert len(renders) == ("image" in reads)
    assert model.graph.spare == 0


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_the_pack_has_what_the_model_reads_and_no_stage_more(name):
    family = families.family(EXPERIMENTS[name])
    arrays = families.sources(family)
    reads = set(model_of(EXPERIMENTS[name])._shapes({})) - {"image"}
    assert reads <= set(arrays)
    touch = "touch" in families.stages(family)
    assert ("vision" in families.stages(family)) == (EXPERIMENTS[name]["vision"] in ("unoccluded", "occluded"))
    assert touch == EXPERIMENTS[name]["touch"]
    # An experiment's plan and its pack's name the same data.
    assert arrays == families.sources(family, plan("experiment", **EXPERIMENTS[name]))


def test_the_experiments_of_the_issue():
    touch = plan("experiment", **EXPERIMENTS["charts_touch"])
    assert set(touch.left_out) == {
        "unoccluded renders", "occluded renders", "views", "image encoder", "touch readings",
        "reading encoder", "spare touch charts",
    }  # fmt: skip
    seen = plan("experiment", **EXPERIMENTS["charts_unoccluded"])
    assert {"touch", "touch charts", "touch readings", "reading encoder"} <= set(seen.left_out)
    assert set(plan("experiment", **EXPERIMENTS["charts_touch_5"]).kept) == {
        "touch", "touch charts", "spare touch charts",
    }  # fmt: skip
    assert "no image" in str(touch)


def test_parts_put_back_in_are_built():
    experiment = EXPERIMENTS["charts_touch"]
    more = model_of(experiment, plan("experiment", **experiment).including())
    assert {"image", "reading", "rotation", "charts"} <= set(more._shapes({}))
    assert more.graph.spare == 16
    assert families.stages("none-charts", plan("experiment", **experiment).including()) == [
        "surface", "vision", "views", "touch", "charts",
    ]  # fmt: skip


def test_every_part_is_left_out_somewhere_and_in_somewhere():
    plans = [plan("experiment", **experiment) for experiment in EXPERIMENTS.values()]
    for part in SCENES["experiment"]:
        assert {found.needs(part) for found in plans} == {True, False}, part
