"""The objects of a batch.

catalogue/<batch>.csv    object, class, split (empty: see catalogue.csv), batch, source (from the source's path on),
                         checksum (SHA-256), up, scale, others, turn, style
"""

from workflow.run.job import log_to

from palpate import catalogue

log_to(snakemake.log[0])
params = snakemake.params
batches = {entry.object: snakemake.wildcards.batch for entry in params.objects}
entries = catalogue.build(params.root, params.objects, batches, params.seed)
catalogue.write_catalogue(snakemake.output.table, entries, {"inputs": catalogue.sources_of(entries)})
