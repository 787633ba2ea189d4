"""figures/examples_<class>.png: a sheet of a class's objects, their images, readings and touch sites."""

from palpate import Dataset
from palpate.catalogue import log_to
from palpate.reports import figures
from palpate.store import whole

log_to(snakemake.log[0])
with whole(snakemake.output.figure) as path:
    figures.examples(Dataset("."), snakemake.wildcards.name, path)
