"""Error against run time of all stages, and their fronts.

reports/error_vs_runtime.csv    the parts in reports/error_vs_runtime/ without `reference`
reports/error_vs_runtime.md     what of it is to be read, and the references, once for each stage
reports/error_vs_runtime.png    their picture
"""

from palpate.atomic import atomic_write
from palpate.batch import log_to
from studies import figures, summaries, tables

log_to(snakemake.log[0])
table = tables.read(snakemake.input.parts)
tables.write(table.drop(columns="reference"), snakemake.output.table)
tables.write_text(summaries.fronts(table), snakemake.output.text)
with atomic_write(snakemake.output.figure) as path:
    figures.fronts(table, path)
