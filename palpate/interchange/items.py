"""What the layouts share: an export's contents, the images of arrays, the grasps of a split with progress."""

import io
import sys
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from PIL import Image
from tqdm import tqdm

from palpate.catalogue import SPLITS
from palpate.dataset import Dataset, GraspDataset

CARD = "README.md"
# Keys of an item of `GraspDataset` that are text.
TEXT = ("object", "class", "split")


class Layout(NamedTuple):
    """How samples are laid out in files."""

    name: str
    write: Callable[[Path, Mapping[str, GraspDataset]], None]  # the grasps of each split into a folder
    split_files: str  # pattern of a split's files
    # Names of the files or columns that hold an array, by its name and those of its images, if it is of images.
    names: Callable[[str, list[str]], list[str]]


class Contents(NamedTuple):
    """What an export is of, for its card and its description."""

    dataset: Dataset
    splits: Mapping[str, GraspDataset]  # the grasps that are written
    layout: Layout
    licence: str  # as `palpate.interchange.card.spdx` returns it
    source: str  # of the meshes, with their terms, as text, verbatim

    @property
    def grasps(self) -> GraspDataset:
        """Those of the first split, whose arrays all splits have."""
        return next(iter(self.splits.values()))

    @property
    def example(self) -> dict[str, Any]:
        """The first grasp, whose arrays have the shapes of all."""
        return self.grasps[0]

    def names(self) -> dict[str, list[str]]:
        """Names of the files or columns that hold each array, by the array's."""
        example, grasps = self.example, self.grasps
        return {name: self.layout.names(name, [*pictures(grasps, name, example[name])]) for name in grasps.arrays}


def samples_by_split(
    dataset: Dataset, arrays: Iterable[str] | None, samples: str = "grasps"
) -> Mapping[str, GraspDataset]:
    """The grasps or presses of each split that has objects. Raises what `Dataset.grasps` raises."""
    filled = [split for split in SPLITS if split in {record.split for record in dataset}]
    if samples == "presses":
        return {split: dataset.presses(split, dataset.presses(arrays=arrays).arrays) for split in filled}
    camera = None if "vision" in dataset.stages and len(dataset) and dataset[0].cameras > 1 else 0
    whole = dataset.grasps(arrays=arrays, camera=camera)  # the same arrays in each split, an error without objects
    return {split: dataset.grasps(split, whole.arrays, camera) for split in filled}


def versions(dataset: Dataset) -> dict[str, str]:
    """Versions of what made the first object's stores, palpate first."""
    made_by: dict[str, str] = {}
    for stage in dataset.stages:
        made_by |= dataset.array(stage, "object").attrs["versions"]
    return made_by


def with_progress(grasps: GraspDataset, split: str) -> Iterator[dict[str, Any]]:
    """The items of a split; the terminal has a bar."""
    return iter(tqdm(grasps, desc=split, unit=grasps.unit, disable=not sys.stderr.isatty()))


def pictures(grasps: GraspDataset, name: str, values: np.ndarray) -> dict[str, np.ndarray]:
    """The images of an array by name, `reading.0`, `reading.1`, ..., or the array's if it is one image.
    values: (..., h, w), of colours (..., h, w, 3 or 4). Empty for an array that is not of images."""
    if name not in grasps.images:
        return {}
    shape = values.shape[-3 if grasps.images[name] else -2 :]
    if values.shape == shape:
        return {name: values}
    return {f"{name}.{number}": image for number, image in enumerate(values.reshape(-1, *shape))}


def png(image: np.ndarray) -> bytes:
    """A uint8 image as the bytes of a PNG file."""
    return _png(image.tobytes(), image.shape)


@lru_cache(maxsize=16)  # those of an object, and of the empty gel, come again and again
def _png(content: bytes, shape: tuple[int, ...]) -> bytes:  # run lengths take 0.2 to 0.4 of the default's time
    file = io.BytesIO()
    Image.fromarray(np.frombuffer(content, np.uint8).reshape(shape)).save(file, "PNG", compress_type=zlib.Z_RLE)
    return file.getvalue()
