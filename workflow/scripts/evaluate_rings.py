"""One trained model, on the true surface in rings around every touch of a split.

evaluations/rings/<experiment>/seed-<k>.csv    experiment, seed, object, class, split, window, grasp, sensor,
                                               ring (1..5), points, distance (mean squared, m^2, from these
                                               points to the prediction), steps (of training)
"""

import torch

from palpate import Dataset, training
from palpate.atomic import atomic_write
from palpate.batch import log_to
from palpate.evaluation import evaluate

log_to(snakemake.log[0])
torch.set_num_threads(snakemake.threads)
trained = evaluate.load(
    snakemake.input.model,
    snakemake.input.summary,
    snakemake.wildcards.experiment,
    snakemake.params.experiment,
    int(snakemake.wildcards.seed),
    snakemake.params.device,
)
split = snakemake.params.split
data = training.TrainingData.load(".", snakemake.params.experiment, [split])
with atomic_write(snakemake.output.table) as path:
    rows = evaluate.evaluate_rings(trained, data, Dataset(".", ["touch", "rings"]), split)
    rows.to_csv(path, index=False)
