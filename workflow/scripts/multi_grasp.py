"""figures/multi_grasp.png: error with more grasps relative to one."""

from palpate.atomic import atomic_write
from palpate.batch import log_to
from palpate.results import errors
from palpate.results import model_figures as figures

log_to(snakemake.log[0])
evaluations = errors.read(snakemake.input.evaluations)
with atomic_write(snakemake.output.figure) as path:
    figures.multi_grasp(evaluations, path=path, **snakemake.params.setup)
