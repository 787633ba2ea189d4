"""What a copy of the authors' released dataset holds: objects, classes and splits, in their layout.

    surfaces/<class>/<object>.npy          points of the surface
    images/<class>/<object>/<k>.png        grasp k, and unoccluded.png
    scene_info/<class>/<object>/<k>.npy    what the sensors of grasp k sensed, and their poses
    sheets/                                touch charts, which are not read: the workflow makes its own
    split.npy                              dictionary: train, valid, test -> list of <object><class>
    empty_gel.npy                          the reading of an untouched sensor

As the data loaders of facebookresearch/3D-Vision-and-Touch read it. (The released data are of ABC's objects.)
"""

import logging
import os
from pathlib import Path

import numpy as np

from palpate.batch import UnusableObject
from palpate.released.pickles import load_plain

log = logging.getLogger(__name__)

SPLITS = {"train": "train", "valid": "validation", "test": "test"}  # their names and ours
EMPTY_READING, SURFACES, IMAGES, SCENES = "empty_gel.npy", "surfaces", "images", "scene_info"


def file_of(surface: Path, kind: str, name: str) -> Path:
    """A file of the object with this surface, in `IMAGES` or `SCENES`."""
    return surface.parents[2] / kind / surface.parent.name / surface.stem / name


def read_released(root: Path | str) -> dict[str, str]:
    """The split (train, validation, test) of each object of a released dataset that has surface, images, scene info and
    a split, by the path of its surface from the root; by class and name. Others are omitted, as in the authors'
    loaders, and named in a warning. Raises UnusableObject, naming file and remedy, if there is no such object, a folder
    or `split.npy` is missing, or `split.npy` is invalid."""
    root = Path(root)
    for folder in (SURFACES, IMAGES, SCENES):
        if not (root / folder).is_dir():
            expected = f"set source.path to the folder that holds {SURFACES}, {IMAGES}, {SCENES} and split.npy"
            raise UnusableObject(f"{root / folder}: no such folder: {expected}")
    splits = read_splits(root / "split.npy")
    complete, without = {}, []
    for class_name in subfolders(root / IMAGES):
        for name in subfolders(root / IMAGES / class_name):
            surface, split = f"{SURFACES}/{class_name}/{name}.npy", splits.get(name + class_name)
            if split and (root / surface).is_file() and (root / SCENES / class_name / name).is_dir():
                complete[surface] = split
            else:
                without.append(f"{class_name}/{name}")
    if without:
        what = "objects without surface, scene info or split"
        log.warning("%s: %d %s: %s", root, len(without), what, ", ".join(without[:10]))
    if not complete:
        raise UnusableObject(f"{root}: no object has surface, images, scene info and a split: unpack the dataset again")
    return complete


def read_splits(path: Path | str) -> dict[str, str]:
    """`split.npy`: our split of each `<object><class>`. Raises UnusableObject if it is invalid."""
    lists = load_plain(path)
    if not isinstance(lists, dict) or not lists or not set(lists) <= set(SPLITS):
        keys = ", ".join(map(str, lists)) if isinstance(lists, dict) else type(lists).__name__
        raise UnusableObject(f"{path}: expected a dictionary with {', '.join(SPLITS)}, found {keys or 'nothing'}")
    splits: dict[str, str] = {}
    for split, names in lists.items():
        for name in np.asarray(list(names), dtype=str).ravel().tolist():
            if splits.setdefault(name, SPLITS[split]) != SPLITS[split]:
                raise UnusableObject(f"{path}: {name} is in {splits[name]} and in {SPLITS[split]}")
    return splits


def files(surface: Path) -> list[str]:
    """The images and scenes of the object with this surface, relative to its folder, sorted."""
    folders = (file_of(surface, kind, "") for kind in (IMAGES, SCENES))
    there = (file for folder in folders for file in folder.iterdir() if file.is_file())
    return sorted(os.path.relpath(file, surface.parent) for file in there)


def subfolders(folder: Path | str) -> list[str]:
    """Names of the folders in a folder that are not hidden, sorted."""
    return sorted(entry.name for entry in os.scandir(folder) if entry.is_dir() and not entry.name.startswith("."))
