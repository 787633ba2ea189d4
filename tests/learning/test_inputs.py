"""The table of inputs: every row of config/experiments.yaml against the arrays that its model reads."""

from dataclasses import replace

import pytest

from palpate.charts import sphere
from palpate.experiments import Experiments
from palpate.learning.checkpoints import build
from palpate.learning.inputs import INPUTS, inputs, stages
from palpate.models import SINGLE_IMAGE_MODELS
from palpate.models.templates import Templates
from palpate.store import CONTRACT
from tests.learning.conftest import ARCHITECTURE

EXPERIMENTS = Experiments.read("config/experiments.yaml", "workflow/schemas/experiments.schema.yaml").experiments


def names(experiment):
    return {item.name for item in inputs(experiment)}


PUBLISHED = [name for name, row in EXPERIMENTS.items() if row.strategy in SINGLE_IMAGE_MODELS]


NOT_TRAINED = [name for name, row in EXPERIMENTS.items() if not row.is_trained]


@pytest.mark.parametrize("name", [name for name in EXPERIMENTS if name not in PUBLISHED + NOT_TRAINED])
def test_an_experiment_takes_what_its_model_reads_and_no_more(name):
    experiment = EXPERIMENTS[name]
    templates = Templates(sphere()[0][None]) if experiment.strategy == "template" else None
    model = build(experiment, ARCHITECTURE, templates=templates)
    reads, images = set(model._shapes({})), {"unoccluded", "occluded", "views"}
    taken = names(experiment)
    silhouettes, of_silhouettes = {each for each in taken if "silhouette" in each}, {"mask", "hand", "camera_number"}
    assert ("mask" in reads) == bool(silhouettes) == ("camera_number" in reads)
    assert ("hand" in reads) == ("hand_silhouette" in silhouettes) == ("occluded_silhouette" in silhouettes)
    taken, reads = taken - silhouettes, reads - of_silhouettes
    assert len(taken & images) == ("image" in reads) == hasattr(model, "encoder")
    assert taken - images - {"points", "camera", "image_camera"} == reads - {"image", "camera"}
    assert len({"camera", "image_camera"} & taken) == hasattr(model, "encoder")
    assert ("reading" in taken) == hasattr(model, "reading_encoder")
    assert model.graph.touch_charts == (
        4 * experiment.grasps if experiment.touch and experiment.strategy in ("charts", "no_copy") else 0
    )


@pytest.mark.parametrize("name", [name for name, row in EXPERIMENTS.items() if row.strategy == "template"])
def test_a_template_model_takes_what_charts_and_retrieval_take_and_rotations_and_is_trained_on_the_templates(name):
    experiment = EXPERIMENTS[name]
    others = (names(replace(experiment, strategy=strategy)) for strategy in ("charts", "retrieval"))
    assert names(experiment) == set.union(*others) | ({"rotation"} if experiment.touch else set())
    assert {item.name for item in inputs(experiment, training=True)} - names(experiment) == {"template"}


@pytest.mark.parametrize("name", PUBLISHED)
def test_the_published_single_image_networks_take_what_ours_takes(name):
    assert names(EXPERIMENTS[name]) == names(EXPERIMENTS["single_image"]) == {"points", "views", "camera"}


@pytest.mark.parametrize("name", NOT_TRAINED)
def test_retrieval_takes_silhouettes_and_charts(name):
    experiment = EXPERIMENTS[name]
    vision = {"unoccluded_silhouette", "image_camera"} if experiment.has_vision else set()
    vision |= {"occluded_silhouette", "hand_silhouette"} if experiment.vision == "occluded" else set()
    assert names(experiment) == {"points"} | vision | ({"success", "position", "charts"} if experiment.touch else set())


def test_stages_of_the_papers_experiments():
    found = {name: stages(experiment) for name, experiment in EXPERIMENTS.items()}
    assert found["charts_unoccluded"] == found["sphere_unoccluded"] == ["surface", "vision"]
    assert found["charts_touch"] == found["charts_touch_5"] == ["surface", "touch", "charts"]
    assert found["sphere_occluded_touch"] == ["surface", "vision", "touch"]
    assert found["no_comm_unoccluded_touch"] == ["surface", "vision", "touch", "charts"]
    assert found["single_image"] == ["surface", "views"]


def test_touch_comes_in_one_way():
    for experiment in EXPERIMENTS.values():
        assert len({"charts", "reading"} & names(experiment)) == experiment.touch
        assert experiment.takes_charts == ("charts" in names(experiment))


def test_every_array_is_the_contracts_and_is_taken_by_some_and_only_the_truth_by_all():
    for item in INPUTS.values():
        assert set(item.array.split(", ")) <= set(CONTRACT[item.stage].arrays)
        taken = {item in inputs(experiment, training=True) for experiment in EXPERIMENTS.values()}
        assert taken == ({True} if item.name == "points" else {True, False}), item.name
