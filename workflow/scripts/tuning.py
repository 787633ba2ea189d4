"""The grid of hyperparameters: the result of each of its points, the best first.

tables/tuning.csv, .md, .tex    rate, cnn_layers, gcn_layers, width, validation_loss (9000 x Chamfer, m^2),
                                best_step, steps, seconds, parameters
"""

import json
from pathlib import Path

import pandas as pd

from palpate.batch import log_to
from palpate.results.dataset_tables import write_table
from palpate.training import tuning

log_to(snakemake.log[0])
trained = [json.loads(Path(path).read_text()) for path in snakemake.input.points]
table = pd.DataFrame(tuning.summary(snakemake.params.points, trained))
machines = sorted({summary["machine"]["found"] for summary in trained})
table.attrs["note"] = (
    f"Validation loss of {trained[0]['validated']} samples, the best of all evaluations; on {', '.join(machines)}."
)
write_table(table, snakemake.output.table)
