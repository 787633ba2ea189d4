"""figures/local_predictions.png: readings, true and predicted clouds, and touch charts, at some touches."""

from palpate.vision import Renderer  # noqa: F401 - Blender: before anything that loads embree

from palpate import Dataset  # isort: skip
from palpate.batch import log_to  # isort: skip
from palpate.results.local_predictions import STAGES, local_predictions  # isort: skip
from palpate.atomic import atomic_write  # isort: skip

log_to(snakemake.log[0])
dataset, model, fit = Dataset(".", STAGES), snakemake.input.model, snakemake.params.fit
with atomic_write(snakemake.output.figure) as path:
    local_predictions(dataset, model, path, fit, snakemake.threads)
