"""Which objects a run has: the sources of their meshes, their classes, splits and batches."""

from palpate.lazy import lazy_exports

EXPORTS = {
    "record": [
        *("assign_batches", "batch_number", "check_same_run", "in_order", "read_batches"),
        *("write_batches", "write_record"),
    ],
    "source": ["UP_AXIS", "CatalogueError", "Source"],
    "sources": [
        *("LETTERS", "SourceObject", "all_classes", "class_counts", "file_name"),
        *("listed", "scan", "style_of", "unread_lines"),
    ],
    "split": ["PAPER_SPLIT", "SPLITS", "assign_split", "held_out_styles", "suggest_split"],
    "table": [
        *("COLUMNS", "CatalogueEntry", "build", "check_splits", "checksum", "companions", "copies", "copy_lines"),
        *("is_unchanged", "mesh_files", "read_catalogue", "require_unchanged", "source_checksums", "sources_of"),
        *("splits_of", "write_catalogue"),
    ],
    "variants": ["is_collision"],
}
__all__, __getattr__ = lazy_exports(__name__, EXPORTS)
