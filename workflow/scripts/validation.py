"""All checks of all batches, and those that need the whole run (no object in two splits, nothing lost).

reports/validation.csv    check, store, batch, objects, worst, limit, passed, where
"""

from workflow.run.job import log_to

from pathlib import Path

from palpate import seal
from palpate.atomic import atomic_write
from palpate.dataset import validation

log_to(snakemake.log[0])
findings = [finding for path in snakemake.input.batches for finding in validation.read_findings(path)]
with atomic_write(snakemake.output.table, seal.made_of(snakemake.input)) as path:
    validation.combine_validation(findings, Path(snakemake.input.catalogue).parent).to_csv(path, index=False)
