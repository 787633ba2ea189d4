"""The objects of a batch.

catalogue/<batch>.csv    object, class, split (empty: see catalogue.csv), batch, source (from the source's path on),
                         checksum (SHA-256), up, scale, others, turn, style
catalogue/.<batch>.json  see palpate.catalogue.changes
"""

from workflow.run.job import log_to

from pathlib import Path

from palpate import catalogue

log_to(snakemake.log[0])
params, names = snakemake.params, [each.object for each in snakemake.params.objects]
no_splits, batches = dict.fromkeys(names, ""), dict.fromkeys(names, snakemake.wildcards.batch)
files = {each.object: catalogue.mesh_files(Path(params.root, each.source), params.root) for each in params.objects}
stamps = catalogue.stamps(files)
entries = catalogue.build(params.root, params.objects, no_splits, batches, params.seed)
catalogue.write_state(Path(snakemake.output.table).parents[1], snakemake.wildcards.batch, params.state, stamps)
catalogue.write_catalogue(snakemake.output.table, entries)
