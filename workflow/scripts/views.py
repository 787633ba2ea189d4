"""Views of a batch: small images of every object alone, from all around. Arrays: palpate/store/contract.csv.

views/<batch>.zarr, rejected/views/<batch>.csv
"""

from workflow.run.job import log_to

from pathlib import Path

import numpy as np

from palpate.vision import Renderer  # Blender: before anything that loads embree

from palpate import mesh, seal, store  # isort: skip
from palpate.batch import each_object, generator  # isort: skip
from palpate.scene import Scene  # isort: skip
from palpate.vision import views  # isort: skip

log_to(snakemake.log[0])
meshes, params = Path(snakemake.input.meshes), snakemake.params
count, size = params.views["count"], params.views["size"]
renderer = Renderer(params.views["samples"], params.device, snakemake.threads)


def look(name: str) -> dict[str, np.ndarray]:
    at = views.viewpoints(generator(params.seed, name, "views"), count)
    return views.render(renderer, Scene(meshes / name), at, size)._asdict()


usable = filter(set(mesh.usable(meshes)).__contains__, params.objects)
made_from = seal.combine({"seed": params.seed, "views": params.views}, seal.read(meshes))
store.write_batch(snakemake.output, "views", each_object(usable, look, "views"), params.seed, made_from)
