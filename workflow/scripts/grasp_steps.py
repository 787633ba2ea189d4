"""figures/grasp_steps.png: the object; the hand as loaded, placed, and closed; rendered by Blender."""

from palpate.vision import Renderer  # noqa: F401 - Blender: before anything that loads embree

from palpate import Dataset  # isort: skip
from palpate.batch import log_to  # isort: skip
from palpate.results.grasp_steps import grasp_steps  # isort: skip
from palpate.atomic import atomic_write  # isort: skip

log_to(snakemake.log[0])
with atomic_write(snakemake.output.figure) as path:
    grasp_steps(Dataset("."), path, snakemake.threads)
