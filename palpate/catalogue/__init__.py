"""Which objects a run has: their sources, classes, splits and batches; and what a stage does with a batch."""

from palpate.catalogue.batch import (
    Rejection,
    Unusable,
    each_object,
    generator,
    log_to,
    read_rejections,
    write_rejections,
)
from palpate.catalogue.sources import UP_AXIS, CatalogueError, Entry, all_classes, scan
from palpate.catalogue.split import PAPER_SPLIT, SPLITS, assign_split
from palpate.catalogue.table import COLUMNS, batch_names, build, checksum, companions

__all__ = [
    "COLUMNS",
    "PAPER_SPLIT",
    "SPLITS",
    "UP_AXIS",
    "CatalogueError",
    "Entry",
    "Rejection",
    "Unusable",
    "all_classes",
    "assign_split",
    "batch_names",
    "build",
    "checksum",
    "companions",
    "each_object",
    "generator",
    "log_to",
    "read_rejections",
    "scan",
    "write_rejections",
]
