"""What models and their packs leave out: parts of an experiment's plan (`palpate.scene.models`)."""

import csv
from collections.abc import Iterable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from palpate import scene, store
from palpate.models import Reconstruction
from palpate.scene import Plan
from palpate.training import checkpoints, families, pack, recipes
from palpate.training.data import Assembler, windows
from palpate.training.touches import touch_charts
from studies.omitted.omission import Leaving
from studies.subjects import Subject

SEES = {"strategy": "charts", "vision": "unoccluded", "touch": False, "grasps": 1}
FEELS = {"strategy": "charts", "vision": "none", "touch": True, "grasps": 1}
BOTH = SEES | {"touch": True}
SPHERE = BOTH | {"strategy": "sphere"}

# Of packs: a part, an experiment that leaves it out, and which others do.
DATA = (
    ("unoccluded renders", FEELS, "touch only, or occluded vision"),
    ("occluded renders", BOTH, "touch only, or unoccluded vision"),
    ("views", BOTH, "all but single images"),
    ("touch", SEES, "vision only"),
    ("touch charts", SPHERE, "vision only, and strategy sphere"),
    ("touch readings", BOTH, "all but strategy sphere with touch"),
)
# Of models.
PARTS = (
    ("image encoder", FEELS, "touch only"),
    ("reading encoder", BOTH, "all but strategy sphere with touch"),
    ("spare touch charts", SEES, "vision only: all 20"),
    ("spare touch charts", BOTH, "fewer than five grasps: here 16 of 20"),
)
# The same sums in another order: float32 coordinates below 1 m are good to 6e-8 m.
ROUNDING = 1e-6
LAST_LAYER = 0.1


class Made(NamedTuple):
    """What an engine made: tensors by name, and the bytes that it took on disk or in memory."""

    tensors: Mapping[str, Tensor]
    size: int


def leavings(run: Path, subjects: list[Subject], settings: Mapping[str, Any]) -> Iterable[Leaving]:
    """Each part of an experiment's plan, with the first subject of the run.

    run: its stores of surface, touch, charts, vision and views, and its U-Net. settings: `training`, whose
    recipe says the models' layers.
    """
    subject = subjects[0]
    for part, experiment, when in DATA:
        if (run / stage_of(part)).is_dir():
            yield of_pack(run, subject, part, experiment, when, settings["training"]["touch_charts"])
    for part, experiment, when in PARTS:
        yield of_model(run, subject, part, experiment, when, settings["recipe"])


def stage_of(part: str) -> str:
    """The stage whose store holds a part of a pack."""
    return next(iter(families.PARTS[part].values())).stage


def of_pack(run: Path, subject: Subject, part: str, experiment: Mapping[str, Any], when: str, method: str) -> Leaving:
    """The pack of an object: made, read again, and its samples assembled. With touch charts, they are fitted
    first, by the run's U-Net."""
    plan = scene.plan("experiment", **experiment)
    charts = part == "touch charts"

    def made(plan: Plan) -> Made:
        if plan.needs("touch charts") and charts:
            fitted(run, subject, method)
        return packed(run, subject, experiment, plan)

    return Leaving(
        "experiment",
        part,
        when,
        subject.name,
        lambda: made(plan.including(part)),
        lambda: made(plan),
        difference,
        "of any value of a sample",
        size=lambda result: result.size,
        left_out=not plan.needs(part),
    )


def packed(run: Path, subject: Subject, experiment: Mapping[str, Any], plan: Plan) -> Made:
    """The samples of an object from a pack of its own, made by a plan, and that pack's bytes."""
    family = families.family(experiment)
    with TemporaryDirectory() as folder:
        catalogue, path = Path(folder) / "catalogue.csv", Path(folder) / f"{family}.h5"
        with catalogue.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerows([("object", "class", "split"), (subject.name, subject.class_name, "test")])
        batch = subject.batch
        stores = {stage: [run / store.CONTRACT[stage].path(batch)] for stage in families.stages(family, plan)}
        pack.write(path, family, catalogue, stores, plan)
        held = pack.Pack.read(path)
        return Made(Assembler(held)(windows(held, experiment, "test")), path.stat().st_size)


def fitted(run: Path, subject: Subject, method: str) -> np.ndarray:
    """Touch charts of an object's sensors, as the stage `charts` makes them."""
    model = checkpoints.load_touch_depth(run / "models/touch_depth/best.ckpt")
    names = ("reading", "success", "position", "rotation")
    felt = store.read(run / store.CONTRACT["touch"].path(subject.batch), "object", "empty_reading", *names)
    row = felt["object"].tolist().index(subject.name)
    reading, *rest = (felt[name][row].reshape(-1, *felt[name].shape[3:]) for name in names)
    return touch_charts(model, reading, felt["empty_reading"], *rest, method)


def of_model(
    run: Path, subject: Subject, part: str, experiment: Mapping[str, Any], when: str, recipe: Mapping
) -> Leaving:
    """A model's prediction of an object; its size is that of its parameters and of its graph."""
    plan = scene.plan("experiment", **experiment)
    torch.manual_seed(0)
    less = built(experiment, recipe, plan)
    more = widened(less, built(experiment, recipe, plan.including(part)))
    batch = first_sample(run, subject)
    return Leaving(
        "experiment",
        part,
        when,
        subject.name,
        lambda: predicted(more, batch),
        lambda: predicted(less, batch),
        difference,
        "m",
        bound=ROUNDING,
        size=lambda result: result.size,
        left_out=not plan.needs(part),
    )


def first_sample(run: Path, subject: Subject) -> dict[str, Tensor]:
    """All that a model could see of an object at its first grasp."""
    return {
        key: values[:1]
        for seen in (BOTH, SPHERE)
        for key, values in packed(run, subject, seen, scene.plan("experiment", **seen)).tensors.items()
    }


def built(experiment: Mapping[str, Any], recipe: Mapping[str, Any], plan: Plan) -> Reconstruction:
    """The untrained model of an experiment, its layers those of vision and touch, so that there is an encoder
    to put back in. The last layer's weights are such that vertices move by decimetres, as after training."""
    layers = checkpoints.architecture(BOTH, recipes.settings(recipe, BOTH))
    return checkpoints.build(experiment, layers | {"last_layer_scale": LAST_LAYER}, plan).eval()


@torch.no_grad()
def widened(less: Reconstruction, more: Reconstruction) -> Reconstruction:
    """`more` with the weights of `less`; what it alone gives the graph network has no weight."""
    weights = less.state_dict()
    first = "gcn.layers.0.weight"
    wide = torch.zeros_like(more.state_dict()[first])
    # Pooled features come first, those of readings last.
    start = more.pooled - less.pooled
    wide[start : start + len(weights[first])] = weights[first]
    more.load_state_dict(more.state_dict() | weights | {first: wide})
    return more


@torch.inference_mode()
def predicted(model: Reconstruction, batch: Mapping[str, Tensor]) -> Made:
    """Vertices, and the bytes of the model's parameters and buffers."""
    held = (*model.parameters(), *model.buffers())
    return Made({"vertices": model(batch)}, sum(tensor.nbytes for tensor in held))


def difference(one: Made, other: Made) -> float:
    """The greatest of any tensor; infinite if one of them has others, or of another shape."""
    if {key: value.shape for key, value in one.tensors.items()} != {
        key: value.shape for key, value in other.tensors.items()
    }:
        return float("inf")
    return max(float((one.tensors[key].double() - other.tensors[key].double()).abs().max()) for key in one.tensors)
