"""Checks the run again and prints what was checked and found. Fails, with the names, if a check failed.

All files are compared with their checksums. The values of a batch are looked at again if its files are not those of its
table in reports/validation.
"""

from workflow.run.job import log_to

import sys
from pathlib import Path

from palpate.dataset import validation

log_to(snakemake.log[0])
params, run = snakemake.params, Path(snakemake.input.catalogue).parent
passed, message = validation.validate(run, snakemake.input.batches, params.max_penetration, params.sources)
if not passed:
    sys.exit(message)
print(message, file=sys.stderr)
