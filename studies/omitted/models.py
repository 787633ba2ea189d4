"""Omissions of models and of their data: models with needless encoders and charts, and arrays that are not taken.

An experiment's arrays are in `palpate.training.inputs`; `palpate.models.Reconstruction` builds only what the
experiment takes. The naive variants here have the needless inputs, whose features get no weight.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from palpate import store
from palpate.charts import Graph, touch_chart
from palpate.charts.atlas import TOUCH_VERTICES
from palpate.charts.graph import mesh_edges
from palpate.dataset import Dataset
from palpate.hand import SENSORS
from palpate.models import GraphNetwork, Reconstruction
from palpate.models.encoder import ReadingEncoder
from palpate.models.reconstruction import POSE_FEATURES
from palpate.training import TrainingData, checkpoints, recipes
from palpate.training.inputs import INPUTS, inputs, stages
from palpate.training.samples import Assembler, windows
from palpate.training.touches import object_charts
from studies.omitted.omission import Omission
from studies.subjects import Subject

VISION = {"strategy": "charts", "vision": "unoccluded", "touch": False, "grasps": 1}
TOUCH = {"strategy": "charts", "vision": "none", "touch": True, "grasps": 1}
BOTH = VISION | {"touch": True}
SPHERE = BOTH | {"strategy": "sphere"}

# The arrays of an omission of data, and the stage that makes them.
ARRAYS = {
    "unoccluded renders": ("unoccluded",),
    "occluded renders": ("occluded",),
    "views": ("views", "camera"),
    "touch": ("success", "position"),
    "touch charts": ("charts",),
    "touch readings": ("rotation", "reading"),
}
# Of data: what is omitted, an experiment that omits it, and which others do.
DATA = (
    ("unoccluded renders", TOUCH, "touch only, or occluded vision"),
    ("occluded renders", BOTH, "touch only, or unoccluded vision"),
    ("views", BOTH, "all but single images"),
    ("touch", VISION, "vision only"),
    ("touch charts", SPHERE, "vision only, and strategy sphere"),
    ("touch readings", BOTH, "all but strategy sphere with touch"),
)
IMAGE, READING, SPARE = "image encoder", "reading encoder", "spare touch charts"
# Of models.
MODEL = (
    (IMAGE, TOUCH, "touch only"),
    (READING, BOTH, "all but strategy sphere with touch"),
    (SPARE, VISION, "vision only: all 20"),
    (SPARE, BOTH, "fewer than five grasps: here 16 of 20"),
)
GRASPS = 5  # of the largest experiment
# The same sums in another order: float32 coordinates below 1 m are good to 6e-8 m.
ROUNDING = 1e-6
LAST_LAYER = 0.1


class SpareGraph(Graph):
    """A graph with `spare` touch charts more, behind all others: each has vertices and edges, but no neighbour
    among the others, and no faces."""

    def __init__(self, touch_charts: int, kind: str, normalisation: str, spare: int):
        self.spare = spare
        super().__init__(touch_charts, kind, normalisation)

    def _operator(self, edges: Tensor, boundary: Tensor) -> None:
        for _ in range(self.spare):
            edges = torch.cat([edges, mesh_edges(touch_chart().faces) + self.vertices])
            self.vertices += TOUCH_VERTICES
        super()._operator(edges, boundary)


class NaiveReconstruction(Reconstruction):
    """A model with needless inputs; their features are further inputs of its graph network.

    naive: of `IMAGE`, `READING` and `SPARE`; all of them by default. Without touch there is no reading to encode.
    """

    def __init__(
        self,
        strategy: str,
        vision: bool,
        touch: bool,
        grasps: int,
        architecture: Mapping[str, Any],
        naive: Iterable[str] = (IMAGE, READING, SPARE),
    ):
        super().__init__(strategy, vision or IMAGE in naive, touch, grasps, architecture)
        if READING in naive and touch and not self.reads_readings:
            self.reads_readings = True
            self.reading_encoder = ReadingEncoder(norm=architecture["encoder"]["norm"] if vision else "batch")
            features = self.sensors * (self.reading_encoder.features + POSE_FEATURES)
            gcn = architecture["gcn"]
            self.gcn = GraphNetwork(
                len(self.gcn.layers[0].weight) + features,
                *(gcn["width"], gcn["layers"], architecture["init"], architecture["last_layer_scale"]),
            )
        if SPARE in naive:
            charts, graph = self.graph.touch_charts, self.graph
            self.graph = SpareGraph(charts, graph.kind, graph.normalisation, SENSORS * GRASPS - charts)

    def deform(self, batch, positions, given, enforced):
        """The same, with rows for touch charts that no touch fills: in the centre, without features."""
        moving = len(positions)
        spare = self.graph.vertices - moving
        resting = self.centre.to(positions.dtype).expand(spare, positions.shape[1], 3)
        given = [torch.cat([values, values.new_zeros(spare, *values.shape[1:])]) for values in given]
        if enforced is not None:
            enforced = torch.cat([enforced, enforced.new_zeros(spare, *enforced.shape[1:])])
        return super().deform(batch, torch.cat([positions, resting]), given, enforced)[:moving]


class Result(NamedTuple):
    """Tensors by name, and the bytes that the data or the model take in memory."""

    tensors: Mapping[str, Tensor]
    size: int


def omissions(run: Path, subjects: list[Subject], settings: Mapping[str, Any]) -> Iterable[Omission]:
    """Each omission of data and of models, with the first subject of the run.

    run: its stores of surface, touch, charts, vision and views, and its U-Net. settings: `training`, whose
    recipe has the models' layers.
    """
    subject = subjects[0]
    for name, experiment, when in DATA:
        if (run / stage_of(name)).is_dir():
            yield of_data(run, subject, name, experiment, when, settings["training"]["chart_fit"])
    for name, experiment, when in MODEL:
        yield of_model(run, subject, name, experiment, when, settings["recipe"])


def stage_of(name: str) -> str:
    """The stage whose store holds the arrays of an omission."""
    return next(item.stage for item in INPUTS if item.name in ARRAYS[name])


def of_data(run: Path, subject: Subject, name: str, experiment: Mapping[str, Any], when: str, method: str) -> Omission:
    """The data of an object, loaded, and its samples assembled. With touch charts, they are fitted first, by the
    run's U-Net."""

    def with_it() -> Result:
        if name == "touch charts":
            fitted(run, subject, method)
        return loaded(run, subject, experiment, ARRAYS[name])

    return Omission(
        "experiment",
        name,
        when,
        subject.name,
        with_it,
        lambda: loaded(run, subject, experiment),
        difference,
        "of any value of a sample",
        size=lambda result: result.size,
    )


def loaded(run: Path, subject: Subject, experiment: Mapping[str, Any], more: Iterable[str] = ()) -> Result:
    """The samples of an object, from its arrays that an experiment takes and `more`, and the bytes of these."""
    names = {item.name for item in inputs(experiment)} | set(more)
    dataset = Dataset(run, stages(experiment)).select([subject.name])
    data = TrainingData.read(dataset, [item for item in INPUTS if item.name in names])
    samples = windows(data, experiment, *data.splits)
    return Result(Assembler(data, experiment)(samples), sum(values.nbytes for values in data.arrays.values()))


def fitted(run: Path, subject: Subject, method: str) -> np.ndarray:
    """Touch charts of an object's sensors, as the stage `charts` makes them."""
    model = checkpoints.load_touch_depth(run / "models/touch_depth/best.ckpt")
    touch = store.read(run / store.CONTRACT["touch"].path(subject.batch))
    return object_charts(model, touch, [str(name) for name in touch["object"]].index(subject.name), method)


def of_model(
    run: Path, subject: Subject, name: str, experiment: Mapping[str, Any], when: str, recipe: Mapping
) -> Omission:
    """A model's prediction of an object; its size is that of its parameters and of its graph."""
    torch.manual_seed(0)
    less = built(experiment, recipe)
    more = widened(less, built(experiment, recipe, [name]))
    batch = first_sample(run, subject)
    return Omission(
        "experiment",
        name,
        when,
        subject.name,
        lambda: predicted(more, batch),
        lambda: predicted(less, batch),
        difference,
        "m",
        bound=ROUNDING,
        size=lambda result: result.size,
    )


def first_sample(run: Path, subject: Subject) -> dict[str, Tensor]:
    """All that a model could take of an object at its first grasp."""
    return {
        key: values[:1]
        for experiment in (BOTH, SPHERE)
        for key, values in loaded(run, subject, experiment).tensors.items()
    }


def built(experiment: Mapping[str, Any], recipe: Mapping[str, Any], naive: Iterable[str] = ()) -> Reconstruction:
    """The untrained model of an experiment; naive: its needless inputs. Its layers are those of vision and
    touch, so that there is an encoder to add. The last layer's weights are such that vertices move by
    decimetres, as after training."""
    layers = checkpoints.architecture(BOTH, recipes.settings(recipe, BOTH)) | {"last_layer_scale": LAST_LAYER}
    return build(experiment, layers, naive).eval()


def build(experiment: Mapping[str, Any], layers: Mapping[str, Any], naive: Iterable[str] = ()) -> Reconstruction:
    """The untrained model of an experiment, with needless inputs if any are named."""
    vision = experiment["vision"] != "none"
    setup = experiment["strategy"], vision, experiment["touch"], experiment["grasps"], layers
    return NaiveReconstruction(*setup, naive) if naive else Reconstruction(*setup)


@torch.no_grad()
def widened(less: Reconstruction, more: Reconstruction) -> Reconstruction:
    """`more` with the weights of `less`; the features that only `more` has get no weight."""
    weights = less.state_dict()
    first = "gcn.layers.0.weight"
    wide = torch.zeros_like(more.state_dict()[first])
    # Pooled features come first, those of readings last.
    start = more.pooled - less.pooled
    wide[start : start + len(weights[first])] = weights[first]
    more.load_state_dict(more.state_dict() | weights | {first: wide})
    return more


@torch.inference_mode()
def predicted(model: Reconstruction, batch: Mapping[str, Tensor]) -> Result:
    """Vertices, and the bytes of the model's parameters and buffers."""
    held = (*model.parameters(), *model.buffers())
    return Result({"vertices": model(batch)}, sum(tensor.nbytes for tensor in held))


def difference(one: Result, other: Result) -> float:
    """The greatest of any tensor; infinite if one of them has others, or of another shape."""
    if {key: value.shape for key, value in one.tensors.items()} != {
        key: value.shape for key, value in other.tensors.items()
    }:
        return float("inf")
    return max(float((one.tensors[key].double() - other.tensors[key].double()).abs().max()) for key in one.tensors)
