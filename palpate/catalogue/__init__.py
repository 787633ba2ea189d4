"""Which objects a run has: the sources of their meshes, their classes, splits and batches."""

from palpate.lazy import lazy_exports

EXPORTS = {
    "record": ["assign_batches", "check_same_run", "in_order", "read_batches", "write_batches", "write_record"],
    "source": ["CatalogueError", "Source"],
    "sources": ["LETTERS", "SourceObject", "class_counts", "file_name", "listed", "scan", "unread_lines"],
    "split": ["SPLITS", "assign_split"],
    "table": [
        *("COLUMNS", "CatalogueEntry", "build", "check_splits", "checksum", "copies", "copy_lines", "is_unchanged"),
        *("mesh_files", "read_catalogue", "require_unchanged", "source_checksums", "sources_of", "splits_of"),
        "write_catalogue",
    ],
    "variants": ["is_collision"],
}
__all__, __getattr__ = lazy_exports(__name__, EXPORTS)
