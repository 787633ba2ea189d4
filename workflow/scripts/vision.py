"""Images of a batch: every object alone, and in each of its grasps. Arrays: palpate/store/contract.csv.

vision/<batch>.zarr; its attribute `drawn`: cameras, lights and background of each object, where the config has ranges
exr/<batch>/: multilayer EXR masters, if the config keeps them, and seal.json
rejected/vision/<batch>.csv
"""

from workflow.run.job import log_to

from contextlib import ExitStack
from pathlib import Path

from palpate.atomic import atomic_write
from palpate.vision import Renderer  # Blender: before anything that loads embree

from palpate import scene, seal, store  # isort: skip
from palpate.batch import each_object  # isort: skip
from palpate.hand import Hand  # isort: skip
from palpate.scene import GRASP_ARRAYS, Scene  # isort: skip
from palpate.vision.image import vision_record  # isort: skip

log_to(snakemake.log[0])
meshes, settings, seed = Path(snakemake.input.meshes), snakemake.params.vision, snakemake.params.seed
grasps = store.read(snakemake.input.grasps)
made_with, grasps_seal = {"seed": seed, "vision": settings}, store.open(snakemake.input.grasps).seal
made_from = seal.combine(made_with, seal.read(meshes), grasps_seal)
hand, drawn = Hand.from_arrays(grasps, prefix="hand/"), {}

with ExitStack() as outputs:
    masters = outputs.enter_context(atomic_write(snakemake.output.masters[0], made_from)) if settings["exr"] else None
    renderer = Renderer(settings["samples"], settings["device"], snakemake.threads, masters)

    def render(name: str) -> dict:
        row = grasps["object"].tolist().index(name)
        of_object = {array: grasps[array][row] for array in GRASP_ARRAYS}
        own_settings = scene.draw(settings, seed, name)
        drawn[name] = {key: own_settings[key] for key in scene.LOOK if own_settings[key] != settings[key]}
        look = scene.look(own_settings)
        cameras = scene.cameras(own_settings)
        pictures = renderer.render_cameras(Scene.from_grasps(meshes / name, of_object, hand, **look), cameras)
        return vision_record(pictures, cameras)

    images = each_object(grasps["object"], render, "vision")

attributes = {"drawn": {name: drawn[name] for name in images[0]}} if any(drawn.values()) else {}
store.write_batch(snakemake.output, "vision", images, seed, made_from, attributes=attributes)
