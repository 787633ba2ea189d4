"""The verdicts on all stiff and extreme cases, and how far each is from its bound.

reports/stability.csv    the parts in reports/stability/, one below the other
reports/stability.md     what of it is to be read
reports/stability.png    their picture
"""

from palpate.atomic import atomic_write
from palpate.batch import log_to
from studies import figures, summaries, tables

log_to(snakemake.log[0])
table = tables.read(snakemake.input.parts)
tables.write(table, snakemake.output.table)
tables.write_text(summaries.verdicts(table), snakemake.output.text)
with atomic_write(snakemake.output.figure) as path:
    figures.margins(table, path)
