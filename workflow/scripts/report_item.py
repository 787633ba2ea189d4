"""One item of a report.

reports/error_vs_runtime/<item>.csv    the columns of `studies.error_vs_runtime.study.COLUMNS`
reports/stability/<item>.csv           the columns of `studies.stability.cases.COLUMNS`
reports/omitted/<item>.csv             the columns of `studies.omitted.omission.COLUMNS`
"""

from workflow.run.job import log_to

from studies.threads import one_thread

one_thread()

from palpate import seal  # noqa: E402
from studies import report  # noqa: E402

log_to(snakemake.log[0])
table = report.measure(snakemake.wildcards.report, snakemake.wildcards.item, ".", **snakemake.params)
report.write(table, snakemake.output.table, seal.made_of(snakemake.input))
