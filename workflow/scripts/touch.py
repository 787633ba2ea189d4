"""Touches of a batch: depth maps, readings and local clouds of the sensors of every grasp.

touch/<batch>.zarr, rejected/touch/<batch>.csv; arrays: palpate/store/contract.csv
"""

from workflow.run.job import log_to

import logging
from collections import Counter
from pathlib import Path

import numpy as np

from palpate import provenance, store, touch
from palpate.batch import each_object
from palpate.hand import Hand
from palpate.scene import GRASP_ARRAYS, Scene
from palpate.sensor import Sensor, read_background, warn_of_shallow

log_to(snakemake.log[0])
log = logging.getLogger("touch")
meshes, settings, seed = Path(snakemake.input.meshes), snakemake.params.touch, snakemake.params.seed
description = snakemake.params.sensor
grasps = store.read(snakemake.input.grasps)
made_with = {"seed": seed, "touch": {**settings, "sensor": description}}
made_from = provenance.combine(made_with, provenance.of_meshes(meshes), store.open(snakemake.input.grasps).made)
hand = Hand.from_arrays(grasps, prefix="hand/")
image = snakemake.input.background
background = read_background(image, description["resolution"]) if image else None
sensor = Sensor.from_description(description, background)
touches = Counter(shallow=0, touches=0)


def sense(name: str) -> dict[str, np.ndarray]:
    row = grasps["object"].tolist().index(name)
    scene = Scene.from_grasps(meshes / name, {array: grasps[array][row] for array in GRASP_ARRAYS}, hand)
    tracer = touch.scene_tracer(scene, settings["method"], sensor)
    sensed = touch.sense_scene(scene, tracer)
    faces = tracer.faces_in_reach(scene.sensor_position, scene.sensor_rotation)
    log.info(
        "%s: omitted: %s of %s faces outside the swept boxes; readings and points of %d of %d sensors not in contact",
        name, f"{(~faces).sum():,}", f"{len(faces):,}", (~sensed.success).sum(), sensed.success.size,
    )  # fmt: skip
    touches.update(shallow=touch.shallow_touches(sensed, sensor), touches=int(sensed.success.sum()))
    return {"position": scene.sensor_position, "rotation": scene.sensor_rotation, **sensed._asdict()}


readings = each_object(grasps["object"], sense, "touch")
for line in warn_of_shallow(**touches):
    log.warning(line)
more, attributes = {"empty_reading": touch.empty_reading(sensor)}, {"sensor": description, **touches}
store.write_batch(snakemake.output, "touch", readings, seed, made_from, more, attributes)
