"""Points around each object of a batch, and their signed distances to its surface: what strategy `implicit` learns.

distances/<batch>.zarr; arrays: palpate/store/contract.csv
"""

from workflow.run.job import log_to

import logging
from pathlib import Path

import numpy as np

from palpate import mesh, provenance, store
from palpate.batch import generator
from palpate.mesh.signed_distance import AMBIGUOUS, POINTS, sample_distances

log = logging.getLogger(__name__)
log_to(snakemake.log[0])
meshes, seed = Path(snakemake.input.meshes), snakemake.params.seed
surface = store.open(snakemake.input.surface)
names = surface["object"]
points, distance = np.empty((len(names), POINTS, 3), np.float32), np.empty((len(names), POINTS), np.float32)
ambiguity = np.empty(len(names), np.float32)
for place, name in enumerate(names):
    solid, diagonal = mesh.load_collision(meshes / name), mesh.diagonal(meshes / name)
    cloud, draw = surface.get("points", place) - mesh.OBJECT_POSITION, generator(seed, name, "distances")
    points[place], distance[place], ambiguity[place] = sample_distances(
        solid.vertices, solid.faces, cloud, diagonal, draw
    )
    points[place] += np.float32(mesh.OBJECT_POSITION)
    unclear = f", inside is ambiguous at {ambiguity[place]:.1%} of its surface"
    level = logging.WARNING if ambiguity[place] > AMBIGUOUS else logging.INFO
    log.log(level, "distances %d/%d: %s%s", place + 1, len(names), name, unclear if ambiguity[place] > 0 else "")
store.write(
    snakemake.output.distances,
    "distances",
    {"object": names, "distance_points": points, "distance": distance, "ambiguity": ambiguity},
    {"seed": seed, "made_from": provenance.combine({"seed": seed}, provenance.of_meshes(meshes), surface.made)},
)
