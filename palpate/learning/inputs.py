"""The arrays that each experiment takes, and their stages: what workflow inputs and data in memory come from.

It needs neither torch nor the stores.
"""

from collections.abc import Iterator
from typing import NamedTuple

from palpate.experiments import Experiment


class Input(NamedTuple):
    """An array in a training's memory.

    name: of the array there. stage, array: of its store (intrinsics and extrinsics are multiplied). dtype: in memory.
    """

    name: str
    stage: str
    array: str
    dtype: str


_ROWS = (
    ("points", "surface", "points", "float32"),
    ("unoccluded", "vision", "unoccluded", "uint8"),
    ("occluded", "vision", "occluded", "uint8"),
    ("unoccluded_silhouette", "vision", "unoccluded_mask", "bool"),
    ("occluded_silhouette", "vision", "occluded_mask", "bool"),
    ("hand_silhouette", "vision", "occluded_depth, occluded_mask", "bool"),
    ("image_camera", "vision", "intrinsics, extrinsics", "float32"),
    ("views", "views", "image", "uint8"),
    ("camera", "views", "camera", "float32"),
    ("success", "touch", "success", "bool"),
    ("position", "touch", "position", "float32"),
    ("charts", "charts", "vertices", "float32"),
    ("rotation", "touch", "rotation", "float32"),
    ("reading", "touch", "reading", "uint8"),
    ("template", "templates", "vertices", "float32"),
)
INPUTS = {name: Input(name, *row) for name, *row in _ROWS}


def camera_array(experiment: Experiment) -> str | None:
    """The name of the cameras, (o, v, 3, 4), of the images that an experiment takes; None if it takes none."""
    return {"none": None, "views": "camera"}.get(experiment.vision, "image_camera")


def _names(experiment: Experiment) -> Iterator[str]:
    """The names of the arrays that an experiment takes."""
    yield "points"
    if experiment.takes_images:
        yield experiment.vision
    if experiment.takes_masks:
        yield "unoccluded_silhouette"
        yield from ("occluded_silhouette", "hand_silhouette") if experiment.vision == "occluded" else ()
    if camera := camera_array(experiment):
        yield camera
    if experiment.touch:
        yield from ("success", "position")
        # Rotations of sensors are not taken where touch is only copied, or in the paper's graph.
        yield from ["charts"] * experiment.takes_charts
        yield from ["rotation"] * (experiment.strategy in ("sphere", "pooled", "pooled_no_copy", "template"))
        yield from ["reading"] * experiment.takes_readings


def inputs(experiment: Experiment, training: bool = False) -> list[Input]:
    """The arrays that an experiment takes; training: and those that only its training takes."""
    names = [*_names(experiment), *["template"] * (training and experiment.strategy == "template")]
    return [INPUTS[name] for name in names]


def stages(experiment: Experiment, training: bool = False) -> list[str]:
    """The stages whose stores these arrays are read from."""
    return list(dict.fromkeys(item.stage for item in inputs(experiment, training)))
