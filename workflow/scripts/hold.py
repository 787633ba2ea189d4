"""Whether the hand of each grasp of a batch keeps the object when it is let go. Arrays: palpate/store/contract.csv.

hold/<batch>.zarr
"""

from workflow.run.job import log_to

import logging
from dataclasses import replace

from palpate import grasp, seal, store
from palpate.batch import generator
from palpate.rebuild_command import rebuild_advice
from palpate.sensor import DIGIT
from workflow.run.kept_grasps import each_kept

log_to(snakemake.log[0])
inputs, params = snakemake.input, snakemake.params
seed, sensor, remedy = params.seed, replace(DIGIT, **params.sensor), rebuild_advice(inputs.grasps)
made = seal.read(inputs.meshes), store.open(inputs.surface).seal, store.open(inputs.grasps).seal
made_from = seal.combine({"seed": seed, "hold": params.hold}, *made)
held = {}
for name, grasper, kept in each_kept(inputs, params, sensor):
    held[name] = outcome = grasp.hold_grasps(grasper, kept, generator(seed, name, "grasps"), remedy)
    unknown = (outcome["held_along"] < 0).sum()
    logging.info("%s: %d of %d grasps hold", name, (outcome["held"] == 1).sum(), len(outcome["held"]))
    if unknown:
        logging.warning("%s: the engine could not simulate %d of %d directions", name, unknown, outcome["moved"].size)
store.write(snakemake.output.hold, "hold", store.join("hold", held), {"seed": seed, "made_from": made_from})
