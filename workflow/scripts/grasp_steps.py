"""figures/grasp_steps.png: the object; the hand as loaded, placed, and closed; rendered by Blender."""

from palpate.vision import Renderer  # noqa: F401 - Blender: before anything that loads embree

from palpate import Dataset  # isort: skip
from palpate.catalogue import log_to  # isort: skip
from palpate.reports.grasp_steps import grasp_steps  # isort: skip
from palpate.store import whole  # isort: skip

log_to(snakemake.log[0])
with whole(snakemake.output.figure) as path:
    grasp_steps(Dataset("."), path, snakemake.threads)
