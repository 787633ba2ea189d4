"""Error against run time of one stage.

reports/error_vs_runtime/<part>.csv    the columns of `studies.error_vs_runtime.study.COLUMNS`
"""

from studies.threads import one_thread

one_thread()

import importlib  # noqa: E402
from pathlib import Path  # noqa: E402

from palpate.batch import log_to  # noqa: E402
from studies import subjects, tables  # noqa: E402
from studies.error_vs_runtime import study  # noqa: E402

log_to(snakemake.log[0])
params = snakemake.params
part = importlib.import_module(f"studies.error_vs_runtime.{snakemake.wildcards.part}")
picked = subjects.pick(".", params.objects, params.batches)
table = study.measure(part.study(Path("."), picked, params.settings), params.rounds)
tables.write(table, snakemake.output.table)
