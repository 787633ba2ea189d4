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
pressed = snakemake.params.pressed
made_with = {"seed": seed, "touch": {"sensor": description, **({"pressed": True} if pressed else {})}}
made_from = seal.combine(made_with, seal.read(meshes), store.open(snakemake.input.grasps).seal)
hand = Hand.from_arrays(grasps, prefix="hand/")
image = snakemake.input.background
background = read_background(image, description["resolution"]) if image else None
sensor = Sensor.from_description(description, background)


def sense(name: str) -> dict[str, np.ndarray]:
    row = grasps["object"].tolist().index(name)
    scene = Scene.from_grasps(meshes / name, {array: grasps[array][row] for array in GRASP_ARRAYS}, hand)
    sensed = touch.sense_scene(scene, touch.scene_tracer(scene, sensor))
    arrays = {"position": scene.sensor_position, "rotation": scene.sensor_rotation, **sensed._asdict()}
    if pressed:
        force = np.where(sensed.success, grasps["pad_force"][row], 0)
        tracer = touch.scene_tracer(scene, touch.face_sensor(sensor))
        readings = touch.press_sensors(tracer, sensor, scene.sensor_position, scene.sensor_rotation, force)
        readings["reading"][~sensed.success] = 0
        touch.warn_of_strain(name, readings.pop("strain"))
        arrays |= readings
    return arrays


readings = each_object(grasps["object"], sense, "touch")
empty = touch.shade_pressed(np.zeros(sensor.resolution), sensor) if pressed else touch.empty_reading(sensor)
more, attributes = {"empty_reading": empty}, {"sensor": description}
store.write_batch(snakemake.output, "touch", readings, seed, made_from, more, attributes)
