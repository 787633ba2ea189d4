"""Omissions of models: `palpate.models.Reconstruction` builds only what the experiment needs.

The naive variants here have needless encoders and charts, whose features get no weight.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from palpate.architectures import Architecture
from palpate.charts import Graph, touch_chart
from palpate.charts.atlas import TOUCH_VERTICES
from palpate.charts.graph import mesh_edges
from palpate.dataset import Dataset
from palpate.experiments import Experiment
from palpate.learning.data import ExperimentData
from palpate.learning.inputs import inputs, stages
from palpate.learning.recipes import Recipe
from palpate.learning.samples import Assembler, windows
from palpate.models import Reconstruction
from palpate.models.encoder import ReadingEncoder
from palpate.models.gcn import GraphNetwork
from palpate.models.reconstruction import POSE_FEATURES
from studies.omitted.omission import Omission
from studies.subjects import Subject

VISION = Experiment("charts_unoccluded", "charts", "unoccluded", False, 1)
TOUCH = Experiment("charts_touch", "charts", "none", True, 1)
BOTH = replace(VISION, touch=True)
SPHERE = replace(BOTH, strategy="sphere")

IMAGE, READING, SPARE = "image encoder", "reading encoder", "spare touch charts"
# Omissions of models: what is needless, an experiment that omits it, and all experiments that do.
MODEL = (
    (IMAGE, TOUCH, "touch only"),
    (READING, BOTH, "all but strategy sphere with touch"),
    (SPARE, VISION, "vision only: all 20"),
    (SPARE, BOTH, "fewer than five grasps: here 16 of 20"),
)
GRASPS = 5  # of the largest experiment
# The same sums in another order: float32 coordinates below 1 m are good to 6e-8 m.
ROUNDING = 1e-6
LAST_LAYER = 0.1  # scale of the last layer: vertices move by decimetres, as after training


class SpareGraph(Graph):
    """A graph with `spare` further touch charts after all others.

    Each has vertices and edges, but no faces and no neighbours in other charts.
    """

    def __init__(self, touch_charts: int, kind: str, normalisation: str, spare: int):
        self.spare = spare
        super().__init__(touch_charts, kind, normalisation)

    def build_operator(self, edges: Tensor, boundary: Tensor) -> None:
        """As `Graph.build_operator`, with the edges of the spare charts."""
        for _ in range(self.spare):
            edges = torch.cat([edges, mesh_edges(touch_chart().faces) + self.vertices])
            self.vertices += TOUCH_VERTICES
        super().build_operator(edges, boundary)


class NaiveReconstruction(Reconstruction):
    """A model with needless inputs, whose features are further inputs of its first layer.

    naive: subset of `IMAGE`, `READING` and `SPARE`. Without touch there is no reading to encode.
    """

    def __init__(self, experiment: Experiment, architecture: Architecture, naive: Iterable[str], **sensors: Any):
        vision = "unoccluded" if IMAGE in naive and not experiment.has_vision else experiment.vision
        super().__init__(replace(experiment, vision=vision), architecture, **sensors)
        self.needless_readings = READING in naive and experiment.touch and self.touch_input != "readings"
        if self.needless_readings:
            self.reading_encoder = ReadingEncoder()
            features = self.sensors * (self.reading_encoder.features + POSE_FEATURES)
            self.reading_weight = nn.Parameter(torch.empty(features, architecture.gcn.width))
        if SPARE in naive:
            charts, graph = self.graph.touch_charts, self.graph
            self.graphs[-1] = SpareGraph(charts, graph.kind, graph.normalisation, self.hand_sensors * GRASPS - charts)

    def input_products(self, batch: Mapping[str, Tensor]) -> list:
        """As `Reconstruction.input_products`, and those of readings."""
        needless = [self.reading_products(batch)] if self.needless_readings else []
        return super().input_products(batch) + needless

    def deform(
        self, inputs: list, positions: Tensor, mask: Tensor | None, fixed: Tensor | None, gcn: GraphNetwork
    ) -> Tensor:
        """As `Reconstruction.deform`, with rows for spare touch charts: in the centre, with mask 0."""
        moving = len(positions)
        spare = self.graph.vertices - moving
        resting = self.centre.to(positions.dtype).expand(spare, positions.shape[1], 3)
        mask, fixed = (
            None if values is None else torch.cat([values, values.new_zeros(spare, *values.shape[1:])])
            for values in (mask, fixed)
        )
        return super().deform(inputs, torch.cat([positions, resting]), mask, fixed, gcn)[:moving]


def omissions(run: Path, subjects: list[Subject], settings: Mapping[str, Any]) -> Iterable[Omission]:
    """Omissions of models, for the first subject of the run; layers are those of the run's recipe."""
    for name, experiment, when in MODEL:
        yield model_omission(run, subjects[0], name, experiment, when, settings["recipe"])


def model_omission(run: Path, subject: Subject, name: str, experiment: Experiment, when: str, recipe: Mapping):
    """An omission of models: the prediction of an object; size: bytes of parameters and graph."""
    torch.manual_seed(0)
    dataset = Dataset(run, ["touch"])
    sensors = {"hand_sensors": dataset.array("touch", "success").shape[2], "sensor": dataset.sensor}
    # Layers are those of vision and touch, so that there is an encoder to add.
    layers = replace(Recipe.from_row(recipe).settings(BOTH).architecture, last_layer_scale=LAST_LAYER)
    engine, naive = (build(experiment, layers, needless, **sensors).eval() for needless in ([], [name]))
    batch = first_sample(run, subject)
    runs = [partial(predict, model, batch) for model in (copy_weights(engine, naive), engine)]
    how = {"bound": ROUNDING, "size": itemgetter(1)}
    return Omission("experiment", name, when, subject.name, *runs, difference, "m", **how)


def first_sample(run: Path, subject: Subject) -> dict[str, Tensor]:
    """All inputs that any of the models could need of an object, at its first grasp."""
    batch = {}
    for experiment in (BOTH, SPHERE):
        data = ExperimentData.read(Dataset(run, stages(experiment)).select([subject.name]), inputs(experiment))
        batch |= Assembler(data, experiment)(windows(data, experiment, *data.splits)[:1])
    return batch


def build(experiment: Experiment, layers: Architecture, naive: Iterable[str] = (), **sensors: Any) -> Reconstruction:
    """The untrained model of an experiment, with needless inputs if any are named."""
    if naive:
        return NaiveReconstruction(experiment, layers, naive, **sensors)
    return Reconstruction(experiment, layers, **sensors)


@torch.no_grad()
def copy_weights(engine: Reconstruction, naive: Reconstruction) -> Reconstruction:
    """Copy the weights of `engine` to `naive`; features that only `naive` has get weight 0."""
    weights = naive.state_dict()
    for name in ("image_weight", "reading_weight"):
        if name in weights:
            weights[name].zero_()
    naive.load_state_dict(weights | engine.state_dict())
    return naive


@torch.inference_mode()
def predict(model: Reconstruction, batch: Mapping[str, Tensor]) -> tuple[Tensor, int]:
    """Vertices, and the bytes of the model's parameters and buffers."""
    tensors = (*model.parameters(), *model.buffers())
    return model(batch), sum(tensor.nbytes for tensor in tensors)


def difference(one: tuple[Tensor, int], other: tuple[Tensor, int]) -> float:
    """Largest difference of vertices, metres."""
    return float((one[0].double() - other[0].double()).abs().max())
