"""A report: the joined tables of its items, a summary in Markdown, a figure.

reports/<report>.csv    the tables in reports/<report>/, one below the other; of error_vs_runtime without `reference`
reports/<report>.md     the summary
reports/<report>.png    the figure
"""

from workflow.run.job import log_to

from studies import report

log_to(snakemake.log[0])
report.join(snakemake.wildcards.report, snakemake.input.tables, **snakemake.output)
