"""The arrays that experiments take, and their stages, for workflow and training. Needs neither torch nor stores."""

from typing import NamedTuple

from palpate.experiments import Experiment


class Input(NamedTuple):
    """An array in a training's memory, by its name there; of a store the stage and the array; its dtype in memory."""

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
INPUTS = {row[0]: Input(*row) for row in _ROWS}


def inputs(experiment: Experiment, training: bool = False) -> list[Input]:
    """The arrays that an experiment takes; training: and those that only its training takes."""
    return [INPUTS[name] for name in experiment.plan.arrays(experiment.vision, experiment.touch, training)]


def stages(experiment: Experiment, training: bool = False) -> list[str]:
    """The stages whose stores these arrays are read from."""
    return list(dict.fromkeys(item.stage for item in inputs(experiment, training)))
