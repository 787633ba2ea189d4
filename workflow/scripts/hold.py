"""Whether the hand of each grasp of a batch keeps the object when it is let go. Arrays: palpate/store/contract.csv.

hold/<batch>.zarr
"""

from workflow.run.job import log_to

import logging
from dataclasses import replace
from pathlib import Path

from palpate import grasp, mesh, seal, store
from palpate.batch import generator
from palpate.hand import Hand
from palpate.rebuild_command import rebuild_advice
from palpate.sensor import DIGIT

log_to(snakemake.log[0])
log = logging.getLogger("hold")
inputs, params = snakemake.input, snakemake.params
meshes, seed = Path(inputs.meshes), params.seed
grasps, surface = store.read(inputs.grasps), store.open(inputs.surface)
made = [seal.read(meshes), surface.seal, store.open(inputs.grasps).seal]
made_from = seal.combine({"seed": seed, "hold": params.hold}, *made)
hand, sensor = Hand.from_arrays(grasps, prefix="hand/"), replace(DIGIT, **params.sensor)
points = dict(zip(surface["object"], surface["points"], strict=True))
grasper_type = grasp.grasper_type(params.grasps, params.hold)
settings = {key: params.grasps[key] for key in ("timestep", "max_penetration", "thumb_share")}


def let_go(row: int, name: str) -> dict:
    visual, collision = mesh.load_visual(meshes / name), mesh.load_collision(meshes / name)
    kept = {array: values[row] for array, values in grasps.items() if len(values) == len(grasps["object"])}
    grasper = grasper_type(visual, collision, points[name] - mesh.OBJECT_POSITION, hand, sensor=sensor, **settings)
    draw, remedy = generator(seed, name, "grasps"), rebuild_advice(inputs.grasps)
    outcome = grasp.hold_grasps(grasper, kept, draw, remedy)
    unknown = (outcome["held_along"] < 0).sum()
    log.info("%s: %d of %d grasps hold", name, (outcome["held"] == 1).sum(), len(outcome["held"]))
    if unknown:
        log.warning("%s: the engine could not simulate %d of %d directions", name, unknown, outcome["moved"].size)
    return outcome


held = {name: let_go(row, name) for row, name in enumerate(grasps["object"])}
store.write(snakemake.output.hold, "hold", store.join("hold", held), {"seed": seed, "made_from": made_from})
