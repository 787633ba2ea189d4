"""The grasps of a batch that were kept, with what closes the hand again as it was closed for them."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from palpate import grasp, mesh, store
from palpate.hand import Hand
from palpate.sensor import Sensor


def each_kept(inputs: Any, params: Any, sensor: Sensor) -> Iterator[tuple[str, grasp.Grasper, dict[str, np.ndarray]]]:
    """Of each object of a batch its name, its grasper, and its row of each array of the grasps store.

    inputs, params: of a rule; paths of `meshes`, `surface` and `grasps`; the config's `grasps` and `hold`.
    """
    grasps, surface = store.read(inputs.grasps), store.open(inputs.surface)
    hand = Hand.from_arrays(grasps, prefix="hand/")
    points = dict(zip(surface["object"], surface["points"], strict=True))
    grasper_type = grasp.grasper_type(params.grasps, params.hold)
    settings = {key: params.grasps[key] for key in ("timestep", "max_penetration", "thumb_share")}
    specs = store.CONTRACT["grasps"].arrays
    of_objects = [name for name in grasps if name in specs and specs[name].of_objects]
    for row, name in enumerate(grasps["object"]):
        folder = Path(inputs.meshes, name)
        visual, collision = mesh.load_visual(folder), mesh.load_collision(folder)
        grasper = grasper_type(visual, collision, points[name] - mesh.OBJECT_POSITION, hand, sensor=sensor, **settings)
        yield name, grasper, {array: grasps[array][row] for array in of_objects}
