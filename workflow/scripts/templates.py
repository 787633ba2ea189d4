"""The atlas on the surface of each object of a batch: what strategy `template` begins with.

templates/<batch>.zarr; arrays: palpate/store/contract.csv
"""

from workflow.run.job import log_to

import logging

import numpy as np
import torch

from palpate import seal, store
from palpate.charts import fit_atlas

log_to(snakemake.log[0])
torch.set_num_threads(snakemake.threads)
surface, seed = store.open(snakemake.input.surface), snakemake.params.seed
names, vertices = surface["object"], []
for place, name in enumerate(names):
    logging.info("templates %d/%d: %s", place + 1, len(names), name)
    vertices.append(fit_atlas(torch.from_numpy(surface.get("points", place))).numpy())
attributes = {"seed": seed, "made_from": seal.combine({}, surface.seal)}
store.write(snakemake.output.templates, "templates", {"object": names, "vertices": np.stack(vertices)}, attributes)
