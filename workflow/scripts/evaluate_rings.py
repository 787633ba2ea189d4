"""One trained model, on the true surface in rings around every touch of a split.

evaluations/rings/<experiment>/seed-<k>.csv    experiment, seed, object, class, split, window, grasp, sensor,
                                               ring (1..5), points, distance (mean squared, m^2, from these
                                               points to the prediction), steps (of training)
"""

import torch

from palpate import Dataset, store, training
from palpate.catalogue import log_to
from palpate.evaluation import evaluate

log_to(snakemake.log[0])
torch.set_num_threads(snakemake.threads)
device = training.Machine(snakemake.params.device).torch_device()
experiment = snakemake.params.experiment
trained = evaluate.Trained(
    training.load(snakemake.input.model, experiment).to(device),
    snakemake.wildcards.experiment,
    experiment,
    int(snakemake.wildcards.seed),
    evaluate.training_steps(snakemake.input.summary),
    device,
)
pack = training.Pack.read(snakemake.input.pack, [snakemake.params.split])
with store.whole(snakemake.output.table) as path:
    rows = evaluate.evaluate_rings(trained, pack, Dataset("."), snakemake.params.split)
    rows.to_csv(path, index=False)
