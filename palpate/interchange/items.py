"""What the layouts share: which arrays are pictures, the grasps of a split with progress, versions of engines."""

import io
import sys
import zlib
from collections.abc import Iterable, Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from PIL import Image
from tqdm import tqdm

from palpate.catalogue import SPLITS
from palpate.dataset import Dataset, GraspDataset

CARD = "README.md"
# Keys of an item of `GraspDataset` that are text.
TEXT = ("object", "class", "split")


class Place(NamedTuple):
    """Where a layout keeps an array."""

    text: str  # names there, in Markdown
    files: str  # pattern of the files that hold it, and nothing else unless it is a column
    shape: tuple[int, ...]  # of what a record has: of a column of file names, how many
    column: str = ""


def image_names(grasps: GraspDataset) -> dict[str, list[str]]:
    """Names of the images that each array becomes, in the order of `pictures`; none if it is not of images."""
    item = grasps[0]
    named = {name: [*pictures(name, item[name], colours)] for name, colours in grasps.images.items()}
    return {name: named.get(name, []) for name in grasps.sources}


def grasps_by_split(dataset: Dataset, arrays: Iterable[str] | None) -> dict[str, GraspDataset]:
    """The grasps of each split that has objects. Raises what `Dataset.grasps` raises."""
    camera = None if "vision" in dataset.stages and len(dataset) and dataset[0].cameras > 1 else 0
    whole = dataset.grasps(arrays=arrays, camera=camera)  # the same arrays in each split, an error without objects
    found = {record.split for record in dataset}
    return {split: dataset.grasps(split, whole.arrays, camera) for split in SPLITS if split in found}


def versions(dataset: Dataset) -> dict[str, str]:
    """Versions of what made the first object's stores, palpate first."""
    found: dict[str, str] = {}
    for stage in dataset.stages:
        found |= dataset.array(stage, "object").attrs["versions"]
    return found


def with_progress(grasps: GraspDataset, split: str) -> Iterator[dict]:
    """The items of a split; the terminal has a bar."""
    return tqdm(grasps, desc=split, unit="grasp", disable=not sys.stderr.isatty())


def pictures(name: str, values: np.ndarray, colours: bool) -> dict[str, np.ndarray]:
    """The images of an array (..., h, w), with colours (..., h, w, 3 or 4), by name: `reading.0`, `reading.1`, ..."""
    shape = values.shape[-3 if colours else -2 :]
    if values.shape == shape:
        return {name: values}
    return {f"{name}.{number}": image for number, image in enumerate(values.reshape(-1, *shape))}


def png(image: np.ndarray) -> bytes:
    """An image as the bytes of a PNG file; those of an object, and of the empty gel, come again and again."""
    return _png(image.tobytes(), image.shape)


@lru_cache(maxsize=16)
def _png(content: bytes, shape: tuple[int, ...]) -> bytes:
    """Of a uint8 image. Run lengths (Z_RLE) take 0.2 to 0.4 of the default's time."""
    file = io.BytesIO()
    Image.fromarray(np.frombuffer(content, np.uint8).reshape(shape)).save(file, "PNG", compress_type=zlib.Z_RLE)
    return file.getvalue()
