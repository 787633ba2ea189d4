"""Touch charts of a batch: charts/<batch>.zarr; arrays: palpate/store/contract.csv."""

from workflow.run.job import log_to

import logging

import numpy as np
import torch

from palpate import seal, store
from palpate.charts.atlas import TOUCH_VERTICES
from palpate.learning.checkpoints import load_touch_depth, require_sensor
from palpate.learning.machine import Machine
from palpate.learning.touch_charts import touch_charts
from palpate.sensor import Sensor

log_to(snakemake.log[0])
torch.set_num_threads(snakemake.threads)
device = Machine(snakemake.params.device).torch_device()
stored, seed = store.open(snakemake.input.touch), snakemake.params.seed
arrays = ("object", "success", "position", "rotation", "reading", "empty_reading")
touch = {name: stored.get(name) for name in arrays}
model = load_touch_depth(snakemake.input.model).to(device)
sensor = Sensor.from_description(stored.attributes["sensor"])
require_sensor(None, model.sensor, None, sensor, snakemake.input.model)
vertices = np.empty((*touch["success"].shape, TOUCH_VERTICES, 3), np.float32)
for place, name in enumerate(names := touch["object"]):  # by themselves, so that charts do not depend on the batch
    logging.info("charts %d/%d: %s", place + 1, len(names), name)
    of_object = {key: touch[key][place] for key in ("reading", "success", "position", "rotation")}
    vertices[place] = touch_charts(model, empty=touch["empty_reading"], **of_object)
model_seal = seal.read(snakemake.input.model)
made_with = {"touch_depth": snakemake.params.touch_depth}
made_from = seal.combine(made_with, stored.seal, more={model_seal.label: model_seal.digest})
attributes = {"seed": seed, "made_from": made_from}
store.write(snakemake.output.charts, "charts", {"object": names, "vertices": vertices}, attributes)
