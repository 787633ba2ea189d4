"""The arrays that each experiment takes, and their stages: the table behind workflow inputs and data in memory.

    python -m palpate.inference.inputs config/experiments.yaml     prints a table: experiment, stages, arrays

It needs neither torch nor the stores.
"""

import argparse
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

import yaml
from tabulate import tabulate

from palpate.experiments import Experiment


def camera_array(experiment: Experiment) -> str | None:
    """The name of the cameras, (o, v, 3, 4), of the images that an experiment takes; None if it takes none."""
    return {"none": None, "views": "camera"}.get(experiment.vision, "image_camera")


class Input(NamedTuple):
    """An array in a training's memory.

    name: of the array there. stage, array: of its store (intrinsics and extrinsics are multiplied).
    dtype: in memory. when, condition: which experiments take it, as text and as a function. training: whether only
    their training does.
    """

    name: str
    stage: str
    array: str
    dtype: str
    when: str
    condition: Callable[[Experiment], bool]
    training: bool = False


def _vision(name: str, masks: bool = False) -> tuple[str, Callable[[Experiment], bool]]:
    when = f"vision is {name}, {'in' if masks else 'but for'} retrieval"
    return when, lambda experiment: experiment.vision == name and experiment.takes_masks == masks


_IMAGES = "vision is unoccluded or occluded", lambda experiment: experiment.vision in ("unoccluded", "occluded")
_SILHOUETTES = "in retrieval with vision", lambda experiment: experiment.takes_masks
_TOUCH = "it has touch", lambda experiment: experiment.touch
_IMPLICIT = "an implicit model is trained", lambda experiment: experiment.strategy == "implicit", True
_OCCLUDED = "one of occluded vision is trained", lambda each: each.strategy == "implicit" and each.vision == "occluded"
_DIRECTIONS = "touch is neither in the graph nor only copied", lambda experiment: experiment.takes_directions
INPUTS = (
    Input("points", "surface", "points", "float32", "always: the truth", lambda experiment: True),
    Input("unoccluded", "vision", "unoccluded", "uint8", *_vision("unoccluded")),
    Input("occluded", "vision", "occluded", "uint8", *_vision("occluded")),
    Input("unoccluded_silhouette", "vision", "unoccluded_mask", "bool", *_SILHOUETTES),
    Input("occluded_silhouette", "vision", "occluded_mask", "bool", *_vision("occluded", masks=True)),
    Input("hand_silhouette", "vision", "occluded_depth, occluded_mask", "bool", *_vision("occluded", masks=True)),
    Input("image_camera", "vision", "intrinsics, extrinsics", "float32", *_IMAGES),
    Input("views", "views", "image", "uint8", *_vision("views")),
    Input("camera", "views", "camera", "float32", *_vision("views")),
    Input("success", "touch", "success", "bool", *_TOUCH),
    Input("position", "touch", "position", "float32", *_TOUCH),
    Input("charts", "charts", "vertices", "float32", "touch comes as charts", lambda each: each.takes_charts),
    Input("rotation", "touch", "rotation", "float32", *_DIRECTIONS),
    Input("reading", "touch", "reading", "uint8", "touch comes as readings", lambda each: each.takes_readings),
    Input("distance_points", "distances", "distance_points", "float32", *_IMPLICIT),
    Input("distance", "distances", "distance", "float32", *_IMPLICIT),
    Input("unoccluded_mask", "vision", "unoccluded_mask", "uint8", *_IMPLICIT),
    Input("occluded_mask", "vision", "occluded_mask", "uint8", *_OCCLUDED, True),
)
TARGETS = [item.name for item in INPUTS if item.training]


def inputs(experiment: Experiment, training: bool = False) -> list[Input]:
    """The arrays that an experiment takes; training: and those that only its training takes."""
    return [item for item in INPUTS if item.condition(experiment) and (training or not item.training)]


def stages(experiment: Experiment, training: bool = False) -> list[str]:
    """The stages whose stores these arrays are read from."""
    return list(dict.fromkeys(item.stage for item in inputs(experiment, training)))


def table(experiments: Iterable[Experiment]) -> str:
    """The stages and arrays of each experiment, as Markdown; then when each array is taken."""
    rows = [
        (each.name, ", ".join(stages(each, True)), ", ".join(item.name for item in inputs(each, True)))
        for each in experiments
    ]
    arrays = [(item.name, f"{item.stage} {item.array}", item.dtype, item.when) for item in INPUTS]
    tables = (rows, ("experiment", "stages", "arrays")), (arrays, ("array", "read from", "type", "taken when"))
    return "\n\n".join(tabulate(*each, "github") for each in tables)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        prog="python -m palpate.inference.inputs", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("experiments", type=Path, help="config/experiments.yaml")
    rows = yaml.safe_load(parser.parse_args().experiments.read_text())["experiments"]
    print(table(Experiment.from_row(name, row) for name, row in rows.items()))
