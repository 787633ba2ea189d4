"""The arrays that each experiment takes, and their stages: the table behind workflow inputs and training data.

    python -m palpate.training.inputs config/experiments.yaml      prints a table: experiment, stages, arrays

It needs neither torch nor the stores. An experiment is a row of `config/experiments.yaml`: its `strategy`,
`vision`, `touch` and `grasps`.
"""

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import yaml
from tabulate import tabulate

Experiment = Mapping[str, Any]


def takes_charts(experiment: Experiment) -> bool:
    """Whether touches reach the model as charts: in all strategies but `sphere` (paper, section 5.1)."""
    return experiment["touch"] and experiment["strategy"] != "sphere"


def takes_readings(experiment: Experiment) -> bool:
    """Whether touches reach the model as readings: in strategy `sphere`."""
    return experiment["touch"] and experiment["strategy"] == "sphere"


def takes_grasps(experiment: Experiment) -> bool:
    """Whether anything that the model takes depends on a grasp: touches, or an occluded image."""
    return experiment["touch"] or experiment["vision"] == "occluded"


def takes_directions(experiment: Experiment) -> bool:
    """Whether the model is told how sensors are turned: not where touch is only copied, or in the paper's graph."""
    in_graph = experiment.get("architecture", {}).get("touch") == "graph"
    return experiment["touch"] and experiment["strategy"] != "no_comm" and not in_graph


def camera_array(experiment: Experiment) -> str | None:
    """The name of the cameras, (o, v, 3, 4), of the images that an experiment takes; None if it takes none."""
    return {"none": None, "views": "camera"}.get(experiment["vision"], "image_camera")


class Input(NamedTuple):
    """An array in a training's memory.

    Attributes:
        name: of the array there. stage, array: of the store that it is read from (intrinsics and extrinsics are
            multiplied). dtype: in memory.
        when, condition: which experiments take it, as text and as a function.
    """

    name: str
    stage: str
    array: str
    dtype: str
    when: str
    condition: Callable[[Experiment], bool]


def _vision(name: str) -> tuple[str, Callable[[Experiment], bool]]:
    return f"vision is {name}", lambda experiment: experiment["vision"] == name


_TOUCH = "it has touch", lambda experiment: experiment["touch"]
_READINGS = "touch comes as readings", takes_readings
INPUTS = (
    Input("points", "surface", "points", "float32", "always: the truth", lambda experiment: True),
    Input("unoccluded", "vision", "unoccluded", "uint8", *_vision("unoccluded")),
    Input("occluded", "vision", "occluded", "uint8", *_vision("occluded")),
    Input(
        "image_camera",
        "vision",
        "intrinsics, extrinsics",
        "float32",
        "vision is unoccluded or occluded",
        lambda experiment: experiment["vision"] in ("unoccluded", "occluded"),
    ),
    Input("views", "views", "image", "uint8", *_vision("views")),
    Input("camera", "views", "camera", "float32", *_vision("views")),
    Input("success", "touch", "success", "bool", *_TOUCH),
    Input("position", "touch", "position", "float32", *_TOUCH),
    Input("charts", "charts", "vertices", "float32", "touch comes as charts", takes_charts),
    Input("rotation", "touch", "rotation", "float32", "touch is pooled, or comes as readings", takes_directions),
    Input("reading", "touch", "reading", "uint8", *_READINGS),
)


def inputs(experiment: Experiment) -> list[Input]:
    """The arrays that an experiment takes."""
    return [item for item in INPUTS if item.condition(experiment)]


def stages(experiment: Experiment) -> list[str]:
    """The stages whose stores an experiment's arrays are read from."""
    return list(dict.fromkeys(item.stage for item in inputs(experiment)))


def table(experiments: Mapping[str, Experiment]) -> str:
    """The stages and arrays of each experiment, as Markdown; then when each array is taken."""
    rows = [
        (name, ", ".join(stages(experiment)), ", ".join(item.name for item in inputs(experiment)))
        for name, experiment in experiments.items()
    ]
    arrays = [(item.name, f"{item.stage} {item.array}", item.dtype, item.when) for item in INPUTS]
    return "\n\n".join(
        [
            tabulate(rows, ("experiment", "stages", "arrays"), "github"),
            tabulate(arrays, ("array", "read from", "type", "taken when"), "github"),
        ]
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        prog="python -m palpate.training.inputs", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("experiments", type=Path, help="config/experiments.yaml")
    print(table(yaml.safe_load(parser.parse_args().experiments.read_text())["experiments"]))
