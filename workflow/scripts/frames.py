"""Frames of a batch: each kept grasp's closing from the open hand to rest. Arrays: palpate/store/contract.csv.

frames/<batch>.zarr
"""

from workflow.run.job import log_to

import logging
from pathlib import Path

import numpy as np

from palpate import grasp, mesh, seal, store, touch
from palpate.batch import generator
from palpate.hand import Hand
from palpate.rebuild_command import rebuild_advice
from palpate.sensor import Sensor, read_background

log_to(snakemake.log[0])
log = logging.getLogger("frames")
inputs, params = snakemake.input, snakemake.params
meshes, seed, description = Path(inputs.meshes), params.seed, params.sensor
grasps, surface = store.read(inputs.grasps), store.open(inputs.surface)
made_with = {"seed": seed, "frames": params.frames, "touch": {"sensor": description}}
made_from = seal.combine(made_with, seal.read(meshes), surface.seal, store.open(inputs.grasps).seal)
hand = Hand.from_arrays(grasps, prefix="hand/")
image = inputs.background
sensor = Sensor.from_description(description, read_background(image, description["resolution"]) if image else None)
points = dict(zip(surface["object"], surface["points"], strict=True))
grasper_type = grasp.grasper_type(params.grasps, params.hold)
settings = {key: params.grasps[key] for key in ("timestep", "max_penetration", "thumb_share")}


def record(row: int, name: str) -> dict:
    visual, collision = mesh.load_visual(meshes / name), mesh.load_collision(meshes / name)
    kept = {array: values[row] for array, values in grasps.items() if len(values) == len(grasps["object"])}
    grasper = grasper_type(visual, collision, points[name] - mesh.OBJECT_POSITION, hand, sensor=sensor, **settings)
    remedy = rebuild_advice(inputs.grasps)
    asked = {"count": params.frames["count"], "with_contacts": params.frames["contacts"], "remedy": remedy}
    frames = grasp.closing_frames(grasper, kept, generator(seed, name, "grasps"), **asked)
    omitted = f"{kept['attempts'] - len(kept['touches'])} closings that gave no kept grasp"
    if params.frames["touch"]:
        tracer = touch.RayCaster(visual, mesh.OBJECT_POSITION, sensor)
        position, rotation = frames["sensor_position"], frames["sensor_rotation"]
        near = tracer.is_near(position, rotation)
        depth = np.full((*near.shape, *sensor.resolution), np.inf, np.float32)
        depth[near] = tracer.trace(position[near], rotation[near])
        frames |= {"depth": depth, "success": np.isfinite(depth).any(axis=(-2, -1))}
        untraced = f"{(~near).sum()} of {near.size} sensors with no face near"
        omitted += f", {untraced}, all of {(~near.any(axis=2)).sum()} of {near[..., 0].size} frames"
    log.info("%s: omitted: %s", name, omitted)
    return frames


frames = {name: record(row, name) for row, name in enumerate(grasps["object"])}
more = {"empty_reading": touch.empty_reading(sensor)} if params.frames["touch"] else {}
attributes = {"seed": seed, "made_from": made_from, "sensor": description}
store.write(snakemake.output.frames, "frames", {**store.join("frames", frames), **more}, attributes)
