"""The objects of a batch.

catalogue/<batch>.csv    object, class, split (empty: see catalogue.csv), batch, source (from the source's path on),
                         checksum (SHA-256), up, scale, others, turn, style
"""

from workflow.run.job import log_to

from palpate import catalogue

log_to(snakemake.log[0])
params, names = snakemake.params, [each.object for each in snakemake.params.objects]
no_splits, batches = dict.fromkeys(names, ""), dict.fromkeys(names, snakemake.wildcards.batch)
entries = catalogue.build(params.root, params.objects, no_splits, batches, params.seed)
catalogue.write_catalogue(snakemake.output.table, entries)
