"""Checks the run again and prints what was checked and found. Fails, with the names, if a check failed.

All files are compared with their checksums. The values of a batch are looked at again if its files are not those of its
table in reports/validation.
"""

import sys
import time

from palpate.batch import log_to, read_rejections
from palpate.catalogue import read_catalogue
from palpate.dataset import validation

log_to(snakemake.log[0])
start, params = time.perf_counter(), snakemake.params
findings, anew = validation.check_again(".", snakemake.input.batches, params.max_penetration)
checks = validation.combine_validation(findings, ".", params.sources)
objects = {finding.object for finding in findings if finding.object}
checked = f"{len(checks)} checks, {len(objects)} objects"
took = f"in {time.perf_counter() - start:.1f} s (values of {anew} of {len(snakemake.input.batches)} batches anew)"

failed = checks[~checks.passed]
if len(failed):
    sys.exit(f"{checked}: {len(failed)} failed, {took}\n{failed.to_string(index=False, max_colwidth=None)}")

catalogue, rejected = read_catalogue(snakemake.input.catalogue), read_rejections([snakemake.input.rejected])
if {entry.object for entry in catalogue} <= {rejection.object for rejection in rejected}:
    sys.exit(f"none of {len(catalogue)} objects could be used; the first: {rejected[0].reason}")
print(f"{checked}: passed, {took}", file=sys.stderr)
