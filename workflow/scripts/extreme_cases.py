"""Stiff and extreme cases of one kind.

reports/stability/<part>.csv    the columns of `studies.stability.cases.COLUMNS`
"""

from studies.threads import one_thread

one_thread()

import importlib  # noqa: E402

from palpate.batch import log_to  # noqa: E402
from studies import subjects, tables  # noqa: E402
from studies.stability import cases  # noqa: E402

log_to(snakemake.log[0])
name = snakemake.wildcards.part
part = importlib.import_module(f"studies.stability.{name}")
picked = subjects.pick(".", 1, snakemake.params.batches)
tables.write(cases.report(name, part.CASES, picked[0]), snakemake.output.table)
