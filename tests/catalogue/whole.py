"""The whole catalogue of a source, as the workflow's rules make it batch by batch."""

import pandas as pd

from palpate.catalogue import COLUMNS, CatalogueEntry, assign_batches, build, in_order, scan, splits_of
from palpate.catalogue.split import PAPER_SPLIT


def whole_catalogue(source, classes, ratios=PAPER_SPLIT, batches=16):
    """batches: of each object by name, or a batch's size."""
    entries = scan(source, classes)
    if isinstance(batches, int):
        batches = assign_batches([entry.object for entry in entries], batches)
    splits = splits_of(entries, ratios)
    entries = [entry._replace(split=splits[entry.object]) for entry in entries]
    rows = build(source.path, in_order(entries, batches), batches)
    return pd.DataFrame(rows, columns=CatalogueEntry._fields).set_axis(COLUMNS, axis=1)
