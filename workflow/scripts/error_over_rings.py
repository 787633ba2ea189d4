"""figures/error_over_rings.png: error at growing distances from a touch."""

from palpate.atomic import atomic_write
from palpate.batch import log_to
from palpate.results import errors
from palpate.results import model_figures as figures

log_to(snakemake.log[0])
rings = errors.read(snakemake.input.evaluations, errors.RING_COLUMNS)
with atomic_write(snakemake.output.figure) as path:
    figures.error_over_rings(rings, path=path, **snakemake.params.setup)
