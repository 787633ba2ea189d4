"""Stiff and extreme cases of one kind.

reports/stability/<part>.csv    the columns of `palpate.trust.cases.COLUMNS`
"""

from palpate.trust.threads import one_thread

one_thread()

import importlib  # noqa: E402

from palpate.catalogue import log_to  # noqa: E402
from palpate.trust import cases, subjects, tables  # noqa: E402

log_to(snakemake.log[0])
name = snakemake.wildcards.part
part = importlib.import_module(f"palpate.trust.stability.{name}")
picked = subjects.pick(".", 1, snakemake.params.batches)
tables.write(cases.report(name, part.CASES, picked[0]), snakemake.output.table)
