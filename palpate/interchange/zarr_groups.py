"""Zarr: a group of format 3 for each split, with an array for each of the dataset's, as xarray opens it.

<folder>/<split>.zarr/<array>    (grasp, ...): axes have names, attributes meaning and unit
                     /object, class, grasp    (grasp,): which grasp of which object
         and what every export has: palpate.interchange.folder
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import zarr
from zarr.codecs import BloscCodec

from palpate.dataset import GraspDataset
from palpate.interchange.items import TEXT, Place, with_progress
from palpate.store.zarr_files import COMPRESSION

ROWS = 16  # grasps of a chunk, and in memory before they are written


def write_zarr_groups(folder: Path, splits: Mapping[str, GraspDataset]) -> None:
    """Write the grasps of each split. Every chunk is written: nothing says what a missing one holds."""
    for split, grasps in splits.items():
        group, rows = zarr.create_group(folder / f"{split}.zarr"), []
        for number, item in enumerate(with_progress(grasps, split), start=1):
            rows.append(item)
            if len(rows) == ROWS or number == len(grasps):
                for name in rows[0]:
                    _append(group, name, [row[name] for row in rows], grasps)
                rows = []


def places(grasps: GraspDataset) -> dict[str, Place]:
    """The path of each array in a split's group."""
    item = grasps[0]
    return {name: Place(f"`{name}`", f"*.zarr/{name}/**", item[name].shape) for name in grasps.sources}


def _append(group: zarr.Group, name: str, values: list, grasps: GraspDataset) -> None:
    """Append values of one array, which is made where it is not there."""
    text, values = name in TEXT, np.array(values, dtype=object if name in TEXT else None)
    if name not in group:
        shape, named = values.shape[1:], ["grasp"]
        if name in grasps.sources and shape:
            named += grasps.dimensions(name)[-len(shape) :]
        stated = (
            {"meaning": spec.meaning, "unit": spec.unit} if (spec := grasps.sources.get(name, (0, None))[1]) else {}
        )
        group.create_array(
            name,
            shape=(0, *shape),
            dtype="string" if text else values.dtype,
            chunks=(ROWS, *shape),
            compressors=None if text else [BloscCodec(**COMPRESSION)],
            attributes=stated,
            dimension_names=named,
        )
    with zarr.config.set({"array.write_empty_chunks": True}):
        group[name].append(values)
