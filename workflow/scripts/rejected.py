"""The rejected objects of all stages and batches.

rejected.csv    object, stage, reason
"""

from workflow.run.job import log_to

from palpate import seal
from palpate.batch import read_rejections, write_rejections

log_to(snakemake.log[0])
write_rejections(snakemake.output.table, read_rejections(snakemake.input.parts), seal.made_of(snakemake.input))
