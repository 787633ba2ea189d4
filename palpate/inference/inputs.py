"""The arrays that each experiment takes, and their stages: the table behind workflow inputs and data in memory.

`inputs.csv` has a row an array. Rotations of sensors are not taken where touch is only copied, or in the paper's graph.
It needs neither torch nor the stores.
"""

import csv
from pathlib import Path
from typing import NamedTuple

from palpate.experiments import Experiment


def camera_array(experiment: Experiment) -> str | None:
    """The name of the cameras, (o, v, 3, 4), of the images that an experiment takes; None if it takes none."""
    return {"none": None, "views": "camera"}.get(experiment.vision, "image_camera")


class Input(NamedTuple):
    """An array in a training's memory: a row of the table.

    name: of the array there. stage, array: of its store (intrinsics and extrinsics are multiplied). dtype: in memory.
    takes, vision, strategy: the experiments that take it, by a property of `Experiment`, and by values with a space
    between; all if empty. training: whether only their training does.
    """

    name: str
    stage: str
    array: str
    dtype: str
    takes: str
    vision: str
    strategy: str
    training: bool

    def is_taken(self, experiment: Experiment) -> bool:
        """Whether an experiment, or its training, takes it."""
        chosen = (self.vision, experiment.vision), (self.strategy, experiment.strategy)
        of_these = all(value in (values.split() or [value]) for values, value in chosen)
        return of_these and (not self.takes or getattr(experiment, self.takes))


with Path(__file__).with_suffix(".csv").open(encoding="utf-8", newline="") as file:
    INPUTS = tuple(Input(**row | {"training": row["training"] == "yes"}) for row in csv.DictReader(file))


def inputs(experiment: Experiment, training: bool = False) -> list[Input]:
    """The arrays that an experiment takes; training: and those that only its training takes."""
    return [item for item in INPUTS if item.is_taken(experiment) and (training or not item.training)]


def stages(experiment: Experiment, training: bool = False) -> list[str]:
    """The stages whose stores these arrays are read from."""
    return list(dict.fromkeys(item.stage for item in inputs(experiment, training)))
