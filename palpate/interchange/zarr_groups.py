"""Zarr: a group of format 3 for each split, with an array for each of the dataset's, as xarray opens it.

<folder>/<split>.zarr/<array>    (grasp, ...): axes have names, attributes meaning and unit
                     /object, class, split, grasp    (grasp,): which grasp of which object
         and what every export has: palpate.interchange.folder
"""

import itertools
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import zarr
from zarr.codecs import BloscCodec

from palpate.dataset import GraspDataset
from palpate.interchange.items import TEXT, Layout, with_progress
from palpate.store.zarr_files import COMPRESSION

# Grasps of a chunk, which is a file, and in memory before they are written. Zarr takes longer to read a grasp by itself
# from a shard than all 16 of a chunk.
ROWS = 16


def write_zarr_groups(folder: Path, splits: Mapping[str, GraspDataset]) -> None:
    """Write the grasps of each split. Every chunk is written: Zarr takes a missing one for zeros."""
    for split, grasps in splits.items():
        group, items = zarr.create_group(folder / f"{split}.zarr"), with_progress(grasps, split)
        arrays = {name: _create(group, name, np.asarray(value), grasps) for name, value in grasps[0].items()}
        for start in range(0, len(grasps), ROWS):
            rows = list(itertools.islice(items, ROWS))
            for name, array in arrays.items():
                array[start : start + len(rows)] = np.array([row[name] for row in rows], array.dtype)


def _create(group: zarr.Group, name: str, value: np.ndarray, grasps: GraspDataset) -> zarr.Array:
    """The array of a name in a split, for values like this of all its grasps."""
    _, spec = grasps.sources.get(name, ("", None))
    return group.create_array(
        name,
        shape=(len(grasps), *value.shape),
        dtype="string" if name in TEXT else value.dtype,
        chunks=(ROWS, *value.shape),
        compressors=BloscCodec(**COMPRESSION),
        attributes={"meaning": spec.meaning, "unit": spec.unit} if spec else {},
        dimension_names=(grasps.unit, *(grasps.dimensions(name) if spec else ())),
        config={"write_empty_chunks": True},
    )


LAYOUT = Layout("zarr", write_zarr_groups, "{}.zarr/**", lambda name, _: [name])
