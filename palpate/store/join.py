"""From the results of each object of a batch to the batch's store."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from palpate.atomic import atomic_write
from palpate.batch import Rejection, write_rejections
from palpate.store.contract import CONTRACT
from palpate.store.files import write


def join(stage: str, records: Mapping[str, Mapping[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """The arrays of a batch, from the named arrays of each of its objects, in the contract's types.

    Arrays with one record an object are stacked, those with one a grasp are joined end to end. Optional
    arrays that no object has are left out. `object`, and `object_index` and `grasp_index` where the contract
    has them, are made here. Axes of a batch without objects have length 0.
    """
    arrays = {"object": np.array(list(records), dtype=str)}
    for name, spec in CONTRACT[stage].arrays.items():
        if spec.shape[0] not in ("o", "og") or name in ("object", "object_index", "grasp_index"):
            continue
        if spec.optional and records and not any(name in record for record in records.values()):
            continue
        parts = [np.asarray(record[name], dtype=spec.dtype) for record in records.values()]
        if not parts:
            arrays[name] = np.empty([size if isinstance(size, int) else 0 for size in spec.shape], spec.dtype)
        else:
            arrays[name] = np.stack(parts) if spec.shape[0] == "o" else np.concatenate(parts)
    if "grasp_index" in CONTRACT[stage].arrays:
        grasps = len(arrays["palm_pose"])
        index = np.arange(grasps, dtype=np.int32)
        each = grasps // max(len(records), 1) or 1
        arrays["object_index"], arrays["grasp_index"] = index // each, index % each
    return arrays


def write_batch(
    path: Path | str,
    stage: str,
    records: Mapping[str, Mapping[str, np.ndarray]],
    rejected: Path | str,
    rejections: Iterable[Rejection],
    seed: int,
    config: Any,
    more: Mapping[str, np.ndarray] = MappingProxyType({}),
) -> None:
    """Write what a stage made of a batch: the table of its rejections, then its store, each whole or not at
    all.

    path, stage: of the store, as for `write`; records: the objects' arrays, as for `join`, and `more` arrays
    of the batch; rejected: path of the table (.csv); config: the part of the config that the store depends
    on. Raises StoreError as `write` does.
    """
    with atomic_write(rejected) as partial:
        write_rejections(partial, rejections)
    attributes = {"seed": seed, "config_digest": config_digest(config)}
    write(path, stage, {**join(stage, records), **more}, attributes)


def config_digest(config: Any) -> str:
    """SHA-256 of the part of the config that a store depends on; stands in its attributes."""
    return hashlib.sha256(json.dumps(config, sort_keys=True).encode()).hexdigest()
