"""figures/multi_grasp.png: error with more grasps relative to one."""

from palpate.catalogue import log_to
from palpate.evaluation import errors, figures
from palpate.store import whole

log_to(snakemake.log[0])
evaluations = errors.read(snakemake.input.evaluations)
with whole(snakemake.output.figure) as path:
    figures.multi_grasp(evaluations, path=path, **snakemake.params.setup)
