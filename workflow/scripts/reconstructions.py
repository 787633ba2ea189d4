"""figures/reconstructions.png: test objects as models of each modality and number of grasps see them."""

from palpate.vision import Renderer  # noqa: F401 - Blender: before anything that loads embree

from pathlib import Path  # isort: skip

from palpate import Dataset  # isort: skip
from palpate.batch import log_to  # isort: skip
from palpate.results.reconstructions import STAGES, reconstructions  # isort: skip
from palpate.atomic import atomic_write  # isort: skip

log_to(snakemake.log[0])
models = {Path(model).parts[1]: model for model in snakemake.input.models}
with atomic_write(snakemake.output.figure) as path:
    reconstructions(Dataset(".", STAGES), models, path, snakemake.params.fit, snakemake.threads)
