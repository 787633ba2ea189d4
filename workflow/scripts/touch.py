"""Touches of a batch: depth maps, readings and local clouds of the four sensors of every grasp.

touch/<batch>.zarr    success         (o, g, 4)                 bool       whether the sensor is in contact
                      position        (o, g, 4, 3)               float64    world frame, m
                      rotation        (o, g, 4, 3, 3)            float64    columns are the sensor's axes
                      depth           (o, g, 4, 100, 100)        float32    m from the gel plane, +inf: nothing
                      reading         (o, g, 4, 100, 100, 3)     uint8
                      points          (o, g, 4, 10000, 3)       float32    local cloud, world frame, m
                      point_count     (o, g, 4)                 int32
                      empty_reading   (100, 100, 3)            uint8      what an untouched sensor reads
rejected/touch/<batch>.csv    object, stage, reason
"""

import logging
from pathlib import Path

import numpy as np

from palpate import store, touch
from palpate.batch import each_object, log_to
from palpate.hand import Hand
from palpate.scene import GRASP_ARRAYS, Scene

log_to(snakemake.log[0])
log = logging.getLogger("touch")
meshes, settings = Path(snakemake.input.meshes), snakemake.params.touch
grasps = store.read(snakemake.input.grasps)
hand = Hand.from_arrays(grasps, prefix="hand/")


def sense(name: str) -> dict[str, np.ndarray]:
    row = grasps["object"].tolist().index(name)
    scene = Scene.from_grasps(meshes / name, {array: grasps[array][row] for array in GRASP_ARRAYS}, hand)
    tracer = touch.scene_tracer(scene, settings["method"])
    sensed = touch.sense_scene(scene, tracer)
    faces = tracer.faces_in_reach(scene.sensor_position, scene.sensor_rotation)
    log.info(
        "%s: omitted: %s of %s faces outside the swept boxes; readings and points of %d of %d sensors not in contact",
        name, f"{(~faces).sum():,}", f"{len(faces):,}", (~sensed.success).sum(), sensed.success.size,
    )  # fmt: skip
    return {"position": scene.sensor_position, "rotation": scene.sensor_rotation, **sensed._asdict()}


readings, rejections = each_object(grasps["object"], sense, "touch")
store.write_batch(
    snakemake.output.touch,
    "touch",
    readings,
    snakemake.output.rejected,
    rejections,
    snakemake.params.seed,
    settings,
    {"empty_reading": touch.empty_reading()},
)
