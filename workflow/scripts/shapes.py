"""Procedural CAD objects of one class, as files.

sources/<class>/<object>.glb | .obj    one file an object, with its materials, metres, z up
"""

from palpate import shapes, store
from palpate.catalogue import log_to
from tqdm import tqdm
import sys

log_to(snakemake.log[0])
name, count, seed = snakemake.params.name, snakemake.params.objects, snakemake.params.seed

with store.whole(snakemake.output.folder) as folder:
    folder.mkdir()
    for index in tqdm(range(count), desc=f"shapes: {name}", unit="object", disable=not sys.stderr.isatty()):
        shapes.write(name, index, shapes.source_path(folder, name, index), seed)
