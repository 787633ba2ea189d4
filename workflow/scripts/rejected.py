"""The rejected objects of all stages and batches.

rejected.csv    object, stage, reason
"""

from workflow.run.job import log_to

from palpate import seal
from palpate.atomic import atomic_write
from palpate.batch import read_rejections, write_rejections

log_to(snakemake.log[0])
with atomic_write(snakemake.output.table, seal.made_of(snakemake.input)) as path:
    write_rejections(path, read_rejections(snakemake.input.parts))
