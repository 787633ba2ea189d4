"""Everything that could not be used, of all stages and batches.

rejected.csv    object, stage, reason
"""

from palpate.catalogue import log_to, read_rejections, write_rejections
from palpate.store import whole

log_to(snakemake.log[0])
with whole(snakemake.output.table) as path:
    write_rejections(path, read_rejections(snakemake.input.parts))
