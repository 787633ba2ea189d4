"""Which objects a run has: the sources of their meshes, their classes, splits and batches."""

from palpate.catalogue.batches import (
    assign_batches,
    batch_number,
    in_order,
    read_places,
    resolve_batch_size,
    write_places,
)
from palpate.catalogue.companion_files import richness
from palpate.catalogue.record import check_same_run, write_record
from palpate.catalogue.source import UP_AXIS, CatalogueError, Source, files_root
from palpate.catalogue.sources import (
    SourceObject,
    all_classes,
    class_counts,
    file_name,
    scan,
)
from palpate.catalogue.split import PAPER_SPLIT, SPLITS, assign_split, suggest_split
from palpate.catalogue.table import (
    COLUMNS,
    CatalogueEntry,
    build,
    check_splits,
    checksum,
    companions,
    empty_splits,
    fill,
    join_copies,
    read_catalogue,
    require_unchanged,
    sources_of,
    splits_of,
)

__all__ = [
    "COLUMNS",
    "PAPER_SPLIT",
    "SPLITS",
    "UP_AXIS",
    "CatalogueEntry",
    "CatalogueError",
    "Source",
    "SourceObject",
    "all_classes",
    "assign_batches",
    "assign_split",
    "batch_number",
    "build",
    "check_same_run",
    "check_splits",
    "checksum",
    "class_counts",
    "companions",
    "empty_splits",
    "file_name",
    "files_root",
    "fill",
    "in_order",
    "join_copies",
    "read_catalogue",
    "read_places",
    "require_unchanged",
    "resolve_batch_size",
    "richness",
    "scan",
    "sources_of",
    "splits_of",
    "suggest_split",
    "write_places",
    "write_record",
]
