"""The local predictions at every successful touch of the validation and test splits.

evaluations/touch_depth.csv    object, class, split, grasp, sensor,
                               cloud (Chamfer distance of the predicted local cloud, m^2 x 9000),
                               chart (that of the chart fitted to it), steps (of training)
"""

import torch

from palpate import Dataset, training
from palpate.atomic import atomic_write
from palpate.batch import log_to
from palpate.evaluation import evaluate

log_to(snakemake.log[0])
torch.set_num_threads(snakemake.threads)
device = training.Machine(snakemake.params.device).torch_device()
rows = evaluate.evaluate_touch(
    training.load_touch_depth(snakemake.input.model).to(device),
    evaluate.training_steps(snakemake.input.summary),
    Dataset(".", ["touch", "charts"]),
    snakemake.params.points,
)
with atomic_write(snakemake.output.table) as path:
    rows.to_csv(path, index=False)
