"""figures/atlas.png: the vision charts before any deformation, slightly separated."""

from palpate.catalogue import log_to
from palpate.reports import atlas
from palpate.store import whole

log_to(snakemake.log[0])
with whole(snakemake.output.figure) as path:
    atlas.draw(path)
