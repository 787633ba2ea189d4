"""The objects of a batch.

catalogue/<batch>.csv    object, class, split, batch, source (from the source's path on), checksum (SHA-256), up, scale,
                         others, turn, style
"""

from workflow.run.job import log_to

from palpate import catalogue

log_to(snakemake.log[0])
root, batch = snakemake.params.root, snakemake.wildcards.batch
objects = [(catalogue.SourceObject(*fields), split) for *fields, split in snakemake.params.objects]
splits = {entry.object: split for entry, split in objects}
entries, batches = [entry for entry, _ in objects], dict.fromkeys(splits, batch)
catalogue.write_catalogue(
    snakemake.output.table, catalogue.build(root, entries, splits, batches, snakemake.params.seed)
)
