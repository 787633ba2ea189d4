"""Every array of every store of a batch against the dataset contract.

reports/validation/<batch>.csv    check, store, batch, object, where, value, limit
"""

from workflow.run.job import log_to

from pathlib import Path

from palpate import seal
from palpate.dataset import validation

log_to(snakemake.log[0])
# Without stores that are no input of this rule, which may be there or not; `snakemake validate` looks at them.
run = Path(snakemake.input.catalogue).parents[1]
findings = validation.validate_batch(run, snakemake.wildcards.batch, snakemake.params.max_penetration, others=False)
validation.write_findings(snakemake.output.table, findings, seal.made_of(snakemake.input))
