"""What the four sensors of every grasp of a batch read.

touch/<batch>.zarr    success         (o, g, 4)                  bool       whether the sensor is in contact
                      position        (o, g, 4, 3)               float64    world frame, m
                      rotation        (o, g, 4, 3, 3)            float64    columns are the sensor's axes
                      depth           (o, g, 4, 100, 100)        float32    m from the gel plane, +inf: nothing
                      reading         (o, g, 4, 100, 100, 3)     uint8
                      points          (o, g, 4, 10000, 3)        float32    local cloud, world frame, m
                      point_count     (o, g, 4)                  int32
                      empty_reading   (100, 100, 3)              uint8      what an untouched sensor reads
rejected/touch/<batch>.csv    object, stage, reason
"""

import logging
from pathlib import Path

import numpy as np

from palpate import mesh, scene, store, touch
from palpate.batch import each_object, log_to

TRACERS = {"embree": touch.RayCaster, "sphere_tracing": touch.SphereTracer}

log_to(snakemake.log[0])
log = logging.getLogger("touch")
plan = scene.plan("touch")
log.info(plan)
meshes, settings = Path(snakemake.input.meshes), snakemake.params.touch
grasps = store.read(snakemake.input.grasps, "object", "sensor_position", "sensor_rotation")
rows = {name: row for row, name in enumerate(grasps["object"])}


def sense(name: str) -> dict[str, np.ndarray]:
    position, rotation = grasps["sensor_position"][rows[name]], grasps["sensor_rotation"][rows[name]]
    tracer = TRACERS[settings["method"]](mesh.load_visual(meshes / name), mesh.OBJECT_POSITION, plan=plan)
    sensors = position.reshape(-1, 3), rotation.reshape(-1, 3, 3)
    felt = touch.sense(tracer, *sensors)
    faces = tracer.felt_faces(*sensors)
    log.info(
        "%s: left out: %s of %s faces outside the swept boxes; %d of %d sensors touched nothing",
        name, f"{(~faces).sum():,}", f"{len(faces):,}", (~felt.success).sum(), len(felt.success),
    )  # fmt: skip
    felt = {key: array.reshape(*position.shape[:2], *array.shape[1:]) for key, array in felt._asdict().items()}
    return {"position": position, "rotation": rotation, **felt}


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
