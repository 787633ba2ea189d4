"""The arrays that each experiment takes, and their stages: the table behind workflow inputs and data in memory.

It needs neither torch nor the stores.
"""

from collections.abc import Callable
from typing import NamedTuple

from palpate.experiments import Experiment


def camera_array(experiment: Experiment) -> str | None:
    """The name of the cameras, (o, v, 3, 4), of the images that an experiment takes; None if it takes none."""
    return {"none": None, "views": "camera"}.get(experiment.vision, "image_camera")


class Input(NamedTuple):
    """An array in a training's memory.

    name: of the array there. stage, array: of its store (intrinsics and extrinsics are multiplied).
    dtype: in memory. condition: which experiments take it. training: whether only their training does.
    """

    name: str
    stage: str
    array: str
    dtype: str
    condition: Callable[[Experiment], bool]
    training: bool = False


def _image(name: str) -> Callable[[Experiment], bool]:
    return lambda each: each.vision == name and each.takes_images


def _cameras(each: Experiment) -> bool:
    return each.vision in ("unoccluded", "occluded")


def _occluded_mask(each: Experiment) -> bool:
    return each.vision == "occluded" and each.takes_masks


def _touch(each: Experiment) -> bool:
    return each.touch


def _implicit(each: Experiment) -> bool:
    return each.strategy == "implicit"


INPUTS = (
    Input("points", "surface", "points", "float32", lambda each: True),  # the truth
    Input("unoccluded", "vision", "unoccluded", "uint8", _image("unoccluded")),
    Input("occluded", "vision", "occluded", "uint8", _image("occluded")),
    Input("unoccluded_silhouette", "vision", "unoccluded_mask", "bool", lambda each: each.takes_masks),
    Input("occluded_silhouette", "vision", "occluded_mask", "bool", _occluded_mask),
    Input("hand_silhouette", "vision", "occluded_depth, occluded_mask", "bool", _occluded_mask),
    Input("image_camera", "vision", "intrinsics, extrinsics", "float32", _cameras),
    Input("views", "views", "image", "uint8", _image("views")),
    Input("camera", "views", "camera", "float32", _image("views")),
    Input("success", "touch", "success", "bool", _touch),
    Input("position", "touch", "position", "float32", _touch),
    Input("charts", "charts", "vertices", "float32", lambda each: each.takes_charts),
    Input("rotation", "touch", "rotation", "float32", lambda each: each.takes_directions),
    Input("reading", "touch", "reading", "uint8", lambda each: each.takes_readings),
    Input("template", "templates", "vertices", "float32", lambda each: each.strategy == "template", True),
    Input("distance_points", "distances", "distance_points", "float32", _implicit, True),
    Input("distance", "distances", "distance", "float32", _implicit, True),
    Input("unoccluded_mask", "vision", "unoccluded_mask", "uint8", _implicit, True),
    Input(
        "occluded_mask",
        "vision",
        "occluded_mask",
        "uint8",
        lambda each: _implicit(each) and each.vision == "occluded",
        True,
    ),
)
TARGETS = [item.name for item in INPUTS if item.training]


def inputs(experiment: Experiment, training: bool = False) -> list[Input]:
    """The arrays that an experiment takes; training: and those that only its training takes."""
    return [item for item in INPUTS if item.condition(experiment) and (training or not item.training)]


def stages(experiment: Experiment, training: bool = False) -> list[str]:
    """The stages whose stores these arrays are read from."""
    return list(dict.fromkeys(item.stage for item in inputs(experiment, training)))
