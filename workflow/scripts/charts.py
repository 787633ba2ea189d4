"""Touch charts of a batch.

charts/<batch>.zarr   vertices   (o, g, 4, 81, 3)   float32   m, world frame; at the sensor if it touched nothing
                      object     (o,)               string
"""

import logging

import torch

from palpate import store, training
from palpate.batch import log_to

log = logging.getLogger(__name__)
log_to(snakemake.log[0])
torch.set_num_threads(snakemake.threads)
device = training.Machine(snakemake.params.device).torch_device()
touch = store.read(snakemake.input.touch, "object", "success", "position", "rotation", "reading", "empty_reading")
model = training.load_touch_depth(snakemake.input.model).to(device)
objects, method = touch["object"], snakemake.params.settings["touch_charts"]
charts = {}
for row, name in enumerate(objects):
    log.info("charts %d/%d: %s", row + 1, len(objects), name)
    # Each object by itself, so that its charts do not depend on the batch.
    sensors = {key: touch[key][row] for key in ("reading", "success", "position", "rotation")}
    reading, *rest = (values.reshape(-1, *values.shape[2:]) for values in sensors.values())
    vertices = training.touch_charts(model, reading, touch["empty_reading"], *rest, method)
    charts[name] = {"vertices": vertices.reshape(*sensors["success"].shape, *vertices.shape[1:])}

store.write(
    snakemake.output.charts,
    "charts",
    store.join("charts", charts),
    {"seed": snakemake.params.seed, "config_digest": store.config_digest(snakemake.params.settings)},
)
