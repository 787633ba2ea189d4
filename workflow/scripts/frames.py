"""Frames of a batch: each kept grasp's closing from the open hand to rest. Arrays: palpate/store/contract.csv.

frames/<batch>.zarr
"""

from workflow.run.job import log_to

import logging

import numpy as np

from palpate import grasp, mesh, seal, store, touch
from palpate.batch import generator
from palpate.rebuild_command import rebuild_advice
from palpate.sensor import Sensor, read_background
from workflow.run.kept_grasps import each_kept

log_to(snakemake.log[0])
inputs, params = snakemake.input, snakemake.params
seed, description, image = params.seed, params.sensor, inputs.background
made_with = {"seed": seed, "frames": params.frames, "touch": {"sensor": description}}
made = seal.read(inputs.meshes), store.open(inputs.surface).seal, store.open(inputs.grasps).seal
made_from = seal.combine(made_with, *made)
sensor = Sensor.from_description(description, read_background(image, description["resolution"]) if image else None)
remedy = rebuild_advice(inputs.grasps)
asked = {"count": params.frames["count"], "with_contacts": params.frames["contacts"], "remedy": remedy}


def record(name: str, grasper: grasp.Grasper, kept: dict) -> dict:
    frames = grasp.closing_frames(grasper, kept, generator(seed, name, "grasps"), **asked)
    omitted = f"{kept['attempts'] - len(kept['touches'])} closings that gave no kept grasp"
    if params.frames["touch"]:
        tracer = grasper.caster  # of the object in its own frame
        position, rotation = frames["sensor_position"] - mesh.OBJECT_POSITION, frames["sensor_rotation"]
        near = tracer.is_near(position, rotation)
        depth = np.full((*near.shape, *sensor.resolution), np.inf, np.float32)
        depth[near] = tracer.trace(position[near], rotation[near])
        frames |= {"depth": depth, "success": np.isfinite(depth).any(axis=(-2, -1))}
        untraced = f"{(~near).sum()} of {near.size} sensors with no face near"
        omitted += f", {untraced}, all of {(~near.any(axis=2)).sum()} of {near[..., 0].size} frames"
    logging.info("%s: omitted: %s", name, omitted)
    return frames


frames = {each[0]: record(*each) for each in each_kept(inputs, params, sensor)}
more = {"empty_reading": touch.empty_reading(sensor)} if params.frames["touch"] else {}
attributes = {"seed": seed, "made_from": made_from, "sensor": description}
store.write(snakemake.output.frames, "frames", {**store.join("frames", frames), **more}, attributes)
