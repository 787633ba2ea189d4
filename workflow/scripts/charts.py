"""Touch charts of a batch.

charts/<batch>.zarr   vertices   (og, 4, 81, 3)   float32   m, world frame; at the sensor if it felt nothing
                      object     (o,)             string
"""

import logging

import numpy as np
import torch

from palpate import store, training
from palpate.batch import log_to

log = logging.getLogger(__name__)
log_to(snakemake.log[0])
torch.set_num_threads(snakemake.threads)
device = training.Machine(snakemake.params.device).torch_device()
felt = store.read(snakemake.input.touch, "object", "success", "position", "rotation", "reading", "empty_reading")
model = training.load_touch_depth(snakemake.input.model).to(device)
each = len(felt["success"]) // max(len(felt["object"]), 1)
shape = felt["success"].shape


def fitted(number: int) -> np.ndarray:
    """Charts of one object's sensors; by themselves, so that they do not depend on the batch."""
    sensors = [
        felt[name][number * each : (number + 1) * each].reshape(-1, *felt[name].shape[2:])
        for name in ("reading", "success", "position", "rotation")
    ]
    log.info("charts %d/%d: %s", number + 1, len(felt["object"]), felt["object"][number])
    reading, *rest = sensors
    return training.touch_charts(
        model, reading, felt["empty_reading"], *rest, snakemake.params.settings["touch_charts"]
    )


charts = [fitted(number) for number in range(len(felt["object"]))]
vertices = np.concatenate(charts) if charts else np.empty((0, 81, 3), np.float32)
store.write(
    snakemake.output.charts,
    "charts",
    {"object": felt["object"], "vertices": vertices.reshape(*shape, *vertices.shape[1:])},
    {"seed": snakemake.params.seed, "config_digest": store.config_digest(snakemake.params.settings)},
)
