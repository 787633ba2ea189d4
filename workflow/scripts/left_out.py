"""What scenes leave out: that the result is the same, and what it saves.

reports/left_out.csv    the parts in reports/left_out/, one below the other
reports/left_out.md     what of it is to be read
reports/left_out.png    their picture
"""

from palpate.atomic import atomic_write
from palpate.batch import log_to
from studies import figures, summaries, tables

log_to(snakemake.log[0])
table = tables.read(snakemake.input.parts)
tables.write(table, snakemake.output.table)
tables.write_text(summaries.savings(table), snakemake.output.text)
with atomic_write(snakemake.output.figure) as path:
    figures.savings(table, path)
