"""Touch charts of a batch.

charts/<batch>.zarr    vertices    (og, 4, 81, 3)    float32    m, world frame; all at the sensor where it felt nothing
                       object      (o,)              string
"""

import torch

from palpate import store, training
from palpate.catalogue import log_to

log_to(snakemake.log[0])
torch.set_num_threads(snakemake.threads)
device = training.Machine(snakemake.params.device).torch_device()
felt = store.read(
    snakemake.input.touch, "object", "success", "position", "rotation", "reading", "empty_reading"
)
sensors = felt["success"].shape
charts = training.touch_charts(
    training.load_touch_depth(snakemake.input.model).to(device),
    felt["empty_reading"],
    *(felt[name].reshape(-1, *felt[name].shape[2:]) for name in ("reading", "success", "position", "rotation")),
    snakemake.params.settings["touch_charts"],
)
store.write(
    snakemake.output.charts,
    "charts",
    {"object": felt["object"], "vertices": charts.reshape(*sensors, *charts.shape[1:])},
    {"seed": snakemake.params.seed, "config_digest": store.config_digest(snakemake.params.settings)},
)
