"""What is omitted in models and in their data changes nothing."""

import itertools
from dataclasses import replace

import networkx
import pytest
import torch

from palpate import Dataset
from palpate.architectures import Architecture
from palpate.charts import Graph, touch_chart
from palpate.charts.graph import mesh_edges
from palpate.learning.data import ExperimentData
from palpate.learning.inputs import INPUTS, inputs, stages
from palpate.learning.samples import Assembler, training_samples, windows
from studies.omitted.models import (
    BOTH,
    IMAGE,
    MODEL,
    READING,
    SPARE,
    SPHERE,
    TOUCH,
    VISION,
    SpareGraph,
    build,
    copy_weights,
    difference,
    predict,
)
from tests.learning.test_data import made  # noqa: F401
from tests.models.batches import SMALL as ROW
from tests.models.batches import random_batch, silhouettes, templates

SMALL = Architecture.from_row(ROW)
NO_COPY, NO_COMM = (replace(BOTH, strategy=strategy) for strategy in ("no_copy", "no_comm"))
VIEWS, OCCLUDED = replace(VISION, vision="views"), replace(BOTH, vision="occluded")
TEMPLATE = tuple(replace(each, strategy="template") for each in (BOTH, TOUCH, replace(TOUCH, grasps=2)))
EXPERIMENTS = (VISION, TOUCH, replace(TOUCH, grasps=2), BOTH, SPHERE, NO_COPY, NO_COMM, VIEWS, OCCLUDED, *TEMPLATE)
EXACT = 1e-12  # m, in double precision


def omissions():
    """Experiments, and needless inputs of their models: each alone, and all at once."""
    for experiment in EXPERIMENTS:
        needless = [SPARE]
        # Of an image a model of strategy template takes more than its features: where it begins.
        needless += [] if experiment.has_vision or experiment in TEMPLATE else [IMAGE]
        # Without touch there is no reading to encode.
        needless += [READING] if experiment.touch and experiment.takes_charts else []
        for naive in [[each] for each in needless] + [needless] * (len(needless) > 1):
            yield experiment, naive


@pytest.mark.parametrize(("experiment", "naive"), list(omissions()))
def test_a_needless_part_without_weight_changes_no_vertex(experiment, naive):
    torch.manual_seed(1)
    known = {"templates": templates(experiment.has_vision)[0]} if experiment in TEMPLATE else {}
    less = build(experiment, SMALL, **known).double().eval()
    more = build(experiment, SMALL, naive, **known).double().eval()
    sizes = [sum(tensor.numel() for tensor in (*model.parameters(), *model.buffers())) for model in (less, more)]
    assert sizes[0] < sizes[1]
    batch = random_batch(2, experiment.grasps, seed=3) | (silhouettes(2) if experiment.has_vision else {})
    one, other = (predict(model, batch) for model in (copy_weights(less, more), less))
    assert difference(one, other) <= EXACT
    displacement = other[0][:, : len(less.start)] - less.start
    assert displacement.norm(dim=2).mean() > 0.01


def test_a_needless_part_with_weight_changes_vertices():
    """The comparison would notice it."""
    torch.manual_seed(1)
    less, more = build(TOUCH, SMALL).double().eval(), build(TOUCH, SMALL, [IMAGE]).double().eval()
    batch = random_batch(2, 1, seed=3)
    copy_weights(less, more)
    with torch.no_grad():
        more.gcn.layers[0].weight[0] += 0.1
    assert difference(predict(more, batch), predict(less, batch)) > 1e-6


@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_all_arrays_give_the_same_samples_in_the_same_order(made, experiment):  # noqa: F811
    every = [item for item in INPUTS.values() if item.stage != "templates"]  # which this fixture has not
    dataset = Dataset(made[0], {item.stage for item in every})
    less, more = (ExperimentData.read(dataset, arrays) for arrays in (inputs(experiment), every))
    assert set(less.arrays) < set(more.arrays)
    assert windows(less, experiment, "train") == windows(more, experiment, "train")
    for step in range(5):
        samples = training_samples(less, experiment, 2, 0, step)
        assert samples == training_samples(more, experiment, 2, 0, step)
        one, other = (Assembler(data, experiment)(samples) for data in (less, more))
        assert one.keys() == other.keys()
        assert all(torch.equal(one[key], other[key]) for key in one)


def test_the_report_has_every_needless_input():
    for name, experiment, _ in MODEL:
        assert (experiment, [name]) in list(omissions())
    assert {name for name, _, _ in MODEL} == {IMAGE, READING, SPARE}


def test_stages_of_what_is_omitted_are_not_read():
    assert not {"vision", "views"} & set(stages(TOUCH)) and not {"touch", "charts"} & set(stages(VISION))


@pytest.mark.parametrize(
    ("kind", "normalisation"), list(itertools.product(["charts", "sphere"], ["symmetric", "mean"]))
)
def test_spare_charts_are_alone(kind, normalisation):
    plain, more = Graph(2, kind, normalisation), SpareGraph(2, kind, normalisation, spare=3)
    assert more.vertices == plain.vertices + 3 * 81 and torch.equal(more.faces, plain.faces)
    features = torch.randn(more.vertices, 4, dtype=torch.float64)
    summed = more.aggregate(features)
    torch.testing.assert_close(summed[: plain.vertices], plain.aggregate(features[: plain.vertices]))
    # Among themselves they are sums over the sheet's neighbours, each chart by itself.
    sheet = networkx.Graph([edge.tolist() for edge in mesh_edges(touch_chart().faces)])
    adjacent = torch.eye(81, dtype=torch.float64)
    for one, other in sheet.edges:
        adjacent[one, other] = adjacent[other, one] = 1
    degree = adjacent.sum(dim=1)
    mean = normalisation == "mean"
    matrix = adjacent / degree[:, None] if mean else adjacent / (degree[:, None] * degree[None]).sqrt()
    for first in range(plain.vertices, more.vertices, 81):
        torch.testing.assert_close(summed[first : first + 81], matrix @ features[first : first + 81])
