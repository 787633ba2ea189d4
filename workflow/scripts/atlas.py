"""figures/atlas.png: the vision charts before any deformation, slightly separated."""

from palpate.atomic import atomic_write
from palpate.batch import log_to
from palpate.results import atlas

log_to(snakemake.log[0])
with atomic_write(snakemake.output.figure) as path:
    atlas.draw(path)
