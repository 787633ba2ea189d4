"""Grasps of a batch: the hand closes on every object. Arrays: palpate/store/contract.csv.

grasps/<batch>.h5, rejected/grasps/<batch>.csv
"""

from workflow.run.job import log_to

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np

from palpate import grasp, hand, mesh, seal, store
from palpate.batch import each_object, generator
from palpate.sensor import DIGIT

log_to(snakemake.log[0])
meshes, seed = Path(snakemake.input.meshes), snakemake.params.seed
settings = dict(snakemake.params.grasps)
mjcf_files = settings.pop("hand")
sensor = replace(DIGIT, **snakemake.params.sensor)  # its lights and gel play no part in grasps
robot = hand.from_mjcf(*snakemake.input.hand, sensor.gel_face) if mjcf_files else hand.allegro(sensor.gel_face)
grasp.check_hand(robot, settings["timestep"], settings["max_penetration"])
surface = store.open(snakemake.input.surface)
chosen = {key: settings.pop(key) for key in ("placement", "object", "grip", "keep")}
hold = dict(snakemake.params.hold)  # empty if it plays no part
made_with = {"seed": seed, "grasps": {**settings, "sensor": snakemake.params.sensor, **(chosen | hold if hold else {})}}
grasper_type = grasp.grasper_type(chosen, hold)
if snakemake.params.pressed:
    made_with["touch"] = {"pressed": True}
made_from = seal.combine(made_with, seal.read(meshes), surface.seal)
points = dict(zip(surface["object"], surface["points"], strict=True))


def close_hand(name: str) -> dict:
    visual, collision = mesh.load_visual(meshes / name), mesh.load_collision(meshes / name)
    draw = generator(seed, name, "grasps")
    options = {**settings, "sensor": sensor, "grasper_type": grasper_type}
    grasps_of_object = grasp.grasp_object(visual, collision, points[name], robot, draw, **options)
    omitted = ", ".join(f"{count:,} {what}" for what, count in grasps_of_object.omitted.items())
    logging.info("%s: omitted: %s", name, omitted)
    more = grasps_of_object.more
    if chosen["keep"] == "hold":
        tried, made, held = grasps_of_object.attempts, grasps_of_object.made, len(grasps_of_object.touches)
        logging.info("%s: %d attempts, %d grasps, of which %d hold", name, tried, made, held)
        more["made"] = np.int32(made)
    arrays = vars(grasps_of_object) | more
    return {key: array for key, array in arrays.items() if snakemake.params.pressed or key != "pad_force"}


grasps = each_object(points, close_hand, "grasps")
hand_arrays = {f"hand/{key}": array for key, array in robot.to_arrays().items()}
store.write_batch(snakemake.output, "grasps", grasps, seed, made_from, hand_arrays)
