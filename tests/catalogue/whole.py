"""The whole catalogue of a source, as the workflow's rules make it batch by batch."""

from palpate.catalogue import PAPER_SPLIT, assign_batches, build, in_order, scan, splits_of


def whole_catalogue(source, classes, ratios=PAPER_SPLIT, batches=16):
    """batches: of each object by name, or a batch's size."""
    entries = scan(source, classes)
    if isinstance(batches, int):
        batches = assign_batches([entry.object for entry in entries], batches)
    return build(source.path, in_order(entries, batches), splits_of(entries, ratios), batches)
