"""Joins the results of a batch's objects, and writes the batch's store."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from palpate.atomic import atomic_write
from palpate.batch import Rejection, write_rejections
from palpate.store.contract import CONTRACT
from palpate.store.files import StoreError, write


def join(stage: str, records: Mapping[str, Mapping[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """The arrays of a batch, from the named arrays of each of its objects, in the contract's types.

    The arrays of the objects are stacked. Optional arrays that no object has are omitted. `object` is made here.
    Axes of a batch without objects have length 0. Raises StoreError if objects have arrays of different shapes.
    """
    arrays = {"object": np.array(list(records), dtype=str)}
    for name, spec in CONTRACT[stage].arrays.items():
        if not spec.of_objects or name == "object":
            continue
        if spec.optional and records and not any(name in record for record in records.values()):
            continue
        rows = {key: np.asarray(record[name], dtype=spec.dtype) for key, record in records.items()}
        shapes = {row.shape: key for key, row in rows.items()}
        if len(shapes) > 1:
            found = ", ".join(f"{shape} of {key}" for shape, key in shapes.items())
            raise StoreError(f"{stage} {name!r} has different shapes: {found}")
        empty = [size if isinstance(size, int) else 0 for size in spec.shape]
        arrays[name] = np.stack(list(rows.values())) if rows else np.empty(empty, spec.dtype)
    return arrays


def write_batch(
    path: Path | str,
    stage: str,
    records: Mapping[str, Mapping[str, np.ndarray]],
    rejected: Path | str,
    rejections: Iterable[Rejection],
    seed: int,
    made_from: Mapping[str, Any],
    more: Mapping[str, np.ndarray] = MappingProxyType({}),
    attributes: Mapping[str, Any] = MappingProxyType({}),
) -> None:
    """Write a stage's results for a batch: the table of rejections, then the store, both atomically.

    path, stage: of the store, as for `write`; records: the objects' arrays, as for `join`, and `more` arrays
    of the batch; rejected: path of the table (.csv); made_from: see `palpate.provenance.combine`; attributes:
    further ones that the stage's stores have. Raises StoreError as `write` does.
    """
    with atomic_write(rejected, checksum=True) as partial:
        write_rejections(partial, rejections)
    write(path, stage, {**join(stage, records), **more}, {"seed": seed, "made_from": made_from, **attributes})
