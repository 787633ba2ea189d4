"""What the scenes of one stage leave out.

reports/left_out/<part>.csv    the columns of `studies.omitted.omission.COLUMNS`
"""

from studies.threads import one_thread

one_thread()

import importlib  # noqa: E402
from pathlib import Path  # noqa: E402

from palpate.batch import log_to  # noqa: E402
from studies import subjects, tables  # noqa: E402
from studies.omitted import omission as leaving  # noqa: E402

log_to(snakemake.log[0])
params = snakemake.params
part = importlib.import_module(f"studies.omitted.{snakemake.wildcards.part}")
picked = subjects.pick(".", params.objects, params.batches)
table = leaving.report(part.leavings(Path("."), picked, params.settings), params.rounds)
tables.write(table, snakemake.output.table)
