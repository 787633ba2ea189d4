"""Touches of a batch: depth maps, readings and local clouds of the sensors of every grasp.

touch/<batch>.zarr, rejected/touch/<batch>.csv; arrays: palpate/store/contract.csv
"""

from workflow.run.job import log_to

from pathlib import Path

import numpy as np

from palpate import seal, store, touch
from palpate.batch import each_object
from palpate.hand import Hand
from palpate.scene import GRASP_ARRAYS, Scene
from palpate.sensor import Sensor, read_background

log_to(snakemake.log[0])
meshes, seed = Path(snakemake.input.meshes), snakemake.params.seed
description = snakemake.params.sensor
grasps = store.read(snakemake.input.grasps)
made_with = {"seed": seed, "touch": {"sensor": description}}
made_from = seal.combine(made_with, seal.read(meshes), store.open(snakemake.input.grasps).seal)
hand = Hand.from_arrays(grasps, prefix="hand/")
image = snakemake.input.background
background = read_background(image, description["resolution"]) if image else None
sensor = Sensor.from_description(description, background)


def sense(name: str) -> dict[str, np.ndarray]:
    row = grasps["object"].tolist().index(name)
    scene = Scene.from_grasps(meshes / name, {array: grasps[array][row] for array in GRASP_ARRAYS}, hand)
    sensed = touch.sense_scene(scene, touch.scene_tracer(scene, sensor))
    return {"position": scene.sensor_position, "rotation": scene.sensor_rotation, **sensed._asdict()}


readings = each_object(grasps["object"], sense, "touch")
more, attributes = {"empty_reading": touch.empty_reading(sensor)}, {"sensor": description}
store.write_batch(snakemake.output, "touch", readings, seed, made_from, more, attributes)
