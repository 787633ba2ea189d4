"""Images of a batch's closing hands, at some of their frames. Arrays: palpate/store/contract.csv.

frame_images/<batch>.zarr, rejected/frame_images/<batch>.csv
"""

from workflow.run.job import log_to

from pathlib import Path

import numpy as np

from palpate.vision import Renderer  # Blender: before anything that loads embree

from palpate import scene, seal, store  # isort: skip
from palpate.batch import each_object  # isort: skip
from palpate.hand import Hand  # isort: skip
from palpate.scene import GRASP_ARRAYS, Scene  # isort: skip

log_to(snakemake.log[0])
inputs, params = snakemake.input, snakemake.params
meshes, settings, seed = Path(inputs.meshes), params.vision, params.seed
frames = store.open(inputs.frames)
made_with = {"seed": seed, "vision": settings, "frames": params.frames}
made_from = seal.combine(made_with, seal.read(meshes), store.open(inputs.grasps).seal, frames.seal)
hand = Hand.from_arrays(store.open(inputs.grasps), prefix="hand/")
_, grasps, count = frames.header("time")[0]
chosen = np.rint(np.linspace(count - 1, 0, params.frames["images"])).astype(int)[::-1]
renderer = Renderer(settings["samples"], settings["device"], snakemake.threads)


def render(name: str) -> dict[str, np.ndarray]:
    row = frames["object"].tolist().index(name)
    at = {array: frames.get(array, row)[:, chosen] for array in GRASP_ARRAYS}
    own_settings = scene.draw(settings, seed, name)
    look = scene.look(own_settings)
    cameras = scene.cameras(own_settings)
    flat = {array: values.reshape(-1, *values.shape[2:]) for array, values in at.items()}
    pictures = renderer.render_cameras(Scene.from_grasps(meshes / name, flat, hand, **look), cameras)
    images = np.stack([[image.rgb for image in held] for _, held in pictures], axis=1)
    numbers = np.broadcast_to(chosen.astype(np.int32), (grasps, len(chosen)))
    return {"image_frame": numbers, "occluded": images.reshape(*numbers.shape, *images.shape[1:])}


images = each_object(frames["object"], render, "frame_images")
store.write_batch(snakemake.output, "frame_images", images, seed, made_from)
