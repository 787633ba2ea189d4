"""Surface points of a batch. Arrays: palpate/store/contract.csv.

surface/<batch>.zarr, rejected/surface/<batch>.csv
"""

from workflow.run.job import log_to

from pathlib import Path

import numpy as np

from palpate import mesh, seal, store, surface
from palpate.batch import each_object, generator

log_to(snakemake.log[0])
meshes, settings, seed = Path(snakemake.input.meshes), snakemake.params.surface, snakemake.params.seed


def sample(name: str) -> dict[str, np.ndarray]:
    visual, draw = mesh.load_geometry(meshes / name), generator(seed, name, "surface")
    points = surface.sample(visual, settings["points"], draw)
    return {"points": points + mesh.OBJECT_POSITION, "scale": mesh.read_record(meshes / name)["scale"]}


usable = filter(set(mesh.usable(meshes)).__contains__, snakemake.params.objects)
made_from = seal.combine({"seed": seed, "surface": settings}, seal.read(meshes))
store.write_batch(snakemake.output, "surface", each_object(usable, sample, "surface"), seed, made_from)
