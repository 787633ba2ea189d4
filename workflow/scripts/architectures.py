"""tables/architectures/<model>.csv (.md, .tex): layers of the live modules beside the paper's."""

from pathlib import Path

from palpate.batch import log_to
from palpate.results.architectures import write_tables

log_to(snakemake.log[0])
write_tables(Path(snakemake.output.tables[0]).parent)
