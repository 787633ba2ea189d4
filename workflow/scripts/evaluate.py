"""One trained model, on every sample of the validation and test splits.

evaluations/<experiment>/seed-<k>.csv    experiment, seed, object, class, split, window,
                                         chamfer (m^2 x 9000), f1_tau, f1_2tau (%, Pixel2Mesh's protocol),
                                         seconds (of the prediction), steps (of training)
"""

import torch

from palpate import training
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
data = training.TrainingData.load(".", snakemake.params.experiment, evaluate.SPLITS)
with atomic_write(snakemake.output.table) as path:
    evaluate.evaluate(trained, data, snakemake.params.points).to_csv(path, index=False)
