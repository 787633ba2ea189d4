"""Every array of every store of a batch against the dataset contract.

reports/validation/<batch>.csv    check, store, batch, object, where, value, limit
"""

from palpate import store
from palpate.catalogue import log_to

log_to(snakemake.log[0])
findings = store.validate_batch(".", snakemake.wildcards.batch, snakemake.params.max_penetration)
store.write_findings(snakemake.output.table, findings)
