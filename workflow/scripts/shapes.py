"""Procedural CAD objects of one class, as files.

sources/<class>/<object>.glb | .obj    one object a file, with its materials; metres, z up
"""

from workflow.run.job import log_to

from palpate import shapes
from palpate.atomic import atomic_write
from palpate.batch import progress

log_to(snakemake.log[0])
name, count, seed = snakemake.params.name, snakemake.params.objects, snakemake.params.seed

with atomic_write(snakemake.output.folder) as folder:
    folder.mkdir()
    for index in progress(range(count), desc=f"shapes: {name}", unit="object"):
        shapes.write(name, index, folder / f"{name}-{index:04d}", seed)
