"""figures/data_point.png: one grasp as the paper's dataset figure."""

from palpate import Dataset
from palpate.catalogue import log_to
from palpate.reports import figures
from palpate.store import whole

log_to(snakemake.log[0])
with whole(snakemake.output.figure) as path:
    figures.data_point(Dataset("."), path)
