"""Images of a batch: every object alone, and in each of its grasps.

vision/<batch>.zarr    unoccluded                      (o, 256, 256, 3)     uint8      sRGB, row 0 at the top
                       occluded                        (o, g, 256, 256, 3)    uint8
                       unoccluded_mask, occluded_mask  (..., 256, 256)      uint8      255: the object
                       unoccluded_depth, occluded_depth                     float16    m along its axis
exr/<batch>/           multilayer EXR masters, if the config keeps them, and manifest.json: sizes and checksums
rejected/vision/<batch>.csv    object, stage, reason
"""

from contextlib import ExitStack
from pathlib import Path

import numpy as np

from palpate.atomic import atomic_write
from palpate.vision import Renderer, paper_camera  # Blender: before anything that loads embree

from palpate import checksums, store  # isort: skip
from palpate.batch import each_object, log_to  # isort: skip
from palpate.hand import Hand  # isort: skip
from palpate.scene import GRASP_ARRAYS, Scene  # isort: skip

log_to(snakemake.log[0])
meshes, settings = Path(snakemake.input.meshes), snakemake.params.vision
grasps = store.read(snakemake.input.grasps)
hand, camera = Hand.from_arrays(grasps, prefix="hand/"), paper_camera(settings["size"])

with ExitStack() as outputs:
    masters = outputs.enter_context(atomic_write(snakemake.output.masters[0])) if settings["exr"] else None
    renderer = Renderer(settings["samples"], settings["device"], snakemake.threads, masters)

    def render(name: str) -> dict[str, np.ndarray]:
        row = grasps["object"].tolist().index(name)
        of_object = {array: grasps[array][row] for array in GRASP_ARRAYS}
        alone, held = renderer.render(Scene.from_grasps(meshes / name, of_object, hand, camera=camera))
        arrays = {"unoccluded": alone.rgb, "unoccluded_mask": alone.mask, "unoccluded_depth": alone.depth}
        for key, field in {"occluded": "rgb", "occluded_mask": "mask", "occluded_depth": "depth"}.items():
            arrays[key] = np.stack([getattr(image, field) for image in held])
        return arrays

    images, rejections = each_object(grasps["object"], render, "vision")
    if masters:
        checksums.write_manifest(masters)

store.write_batch(
    snakemake.output.vision,
    "vision",
    images,
    snakemake.output.rejected,
    rejections,
    snakemake.params.seed,
    settings,
)
