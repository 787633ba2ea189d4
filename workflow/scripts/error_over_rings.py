"""figures/error_over_rings.png: error at growing distances from a touch."""

from palpate.catalogue import log_to
from palpate.evaluation import errors, figures
from palpate.store import whole

log_to(snakemake.log[0])
rings = errors.read(snakemake.input.evaluations, errors.RING_COLUMNS)
with whole(snakemake.output.figure) as path:
    figures.error_over_rings(rings, path=path, **snakemake.params.setup)
