"""Views of a batch: small images of every object alone, from all around. Arrays: palpate/store/contract.csv.

views/<batch>.zarr, rejected/views/<batch>.csv
"""

from workflow.run.job import log_to

from pathlib import Path

import numpy as np

from palpate.vision import Renderer  # Blender: before anything that loads embree

from palpate import mesh, provenance, store  # isort: skip
from palpate.batch import each_object, generator  # isort: skip
from palpate.scene import Scene  # isort: skip
from palpate.vision import views  # isort: skip

log_to(snakemake.log[0])
meshes, params = Path(snakemake.input.meshes), snakemake.params
count, size = params.views["count"], params.views["size"]
if not params.renderings:
    renderer = Renderer(params.views["samples"], params.device, snakemake.threads)


def look(name: str) -> dict[str, np.ndarray]:
    if params.renderings:
        # <synset>/<model>/model.obj shows in <synset>/<model>/rendering/.
        folder = Path(params.renderings, *Path(params.objects[name]).parts[:2], "rendering")
        record = mesh.read_record(meshes / name)
        surface = mesh.load_visual(meshes / name).vertices + mesh.OBJECT_POSITION
        return views.published(folder, record, surface, count, size)._asdict()
    at = views.viewpoints(generator(params.seed, name, "views"), count)
    return views.render(renderer, Scene(meshes / name), at, size)._asdict()


prepared = set(mesh.usable(meshes))
usable = [name for name in params.objects if name in prepared]
made_from = provenance.combine({"seed": params.seed, "views": params.views}, provenance.of_meshes(meshes))
store.write_batch(snakemake.output, "views", each_object(usable, look, "views"), params.seed, made_from)
