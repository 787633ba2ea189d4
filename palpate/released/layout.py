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
from typing import NamedTuple

import numpy as np

from palpate.batch import UnusableObject
from palpate.released.pickles import load_plain

log = logging.getLogger(__name__)

SPLITS = {"train": "train", "valid": "validation", "test": "test"}  # their names and ours
EMPTY_READING, SURFACES, IMAGES, SCENES = "empty_gel.npy", "surfaces", "images", "scene_info"


class ReleasedObject(NamedTuple):
    """One object: its class, its name within the class, and its split (train, validation, test; or empty)."""

    class_name: str
    name: str
    split: str = ""

    @property
    def source(self) -> str:
        """Its surface, relative to the root: the file that the catalogue names."""
        return f"{SURFACES}/{self.class_name}/{self.name}.npy"

    @classmethod
    def from_source(cls, source: str) -> "ReleasedObject":
        return cls(Path(source).parent.name, Path(source).stem)

    def surface(self, root: Path | str) -> Path:
        return Path(root, self.source)

    def image(self, root: Path | str, grasp: int | None = None) -> Path:
        """Image of a grasp, or of the object alone."""
        name = "unoccluded.png" if grasp is None else f"{grasp}.png"
        return Path(root, IMAGES, self.class_name, self.name, name)

    def scene(self, root: Path | str, grasp: int) -> Path:
        """What the sensors of a grasp sensed."""
        return Path(root, SCENES, self.class_name, self.name, f"{grasp}.npy")


def read_released(root: Path | str) -> list[ReleasedObject]:
    """The objects of a released dataset that have surface, images, scene info and a split; by class and name. Others
    are omitted, as in the authors' loaders, and named in a warning. Raises UnusableObject, naming file and remedy, if a
    folder or `split.npy` is missing, or `split.npy` is invalid."""
    root = Path(root)
    for folder in (SURFACES, IMAGES, SCENES):
        if not (root / folder).is_dir():
            expected = f"set source.path to the folder that holds {SURFACES}, {IMAGES}, {SCENES} and split.npy"
            raise UnusableObject(f"{root / folder}: no such folder: {expected}")
    splits = read_splits(root / "split.npy")
    complete, without = [], []
    for class_name in subfolders(root / IMAGES):
        for name in subfolders(root / IMAGES / class_name):
            released = ReleasedObject(class_name, name, splits.get(name + class_name, ""))
            if released.split and released.surface(root).is_file() and (root / SCENES / class_name / name).is_dir():
                complete.append(released)
            else:
                without.append(f"{class_name}/{name}")
    if without:
        what = "objects without surface, scene info or split"
        log.warning("%s: %d %s: %s", root, len(without), what, ", ".join(without[:10]))
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


def files(path: Path) -> list[str]:
    """The other files of an object, relative to the folder of its surface `path`; those that exist."""
    root, class_name, name = path.parents[2], path.parent.name, path.stem
    return [
        f"../../{kind}/{class_name}/{name}/{file}"
        for kind in (IMAGES, SCENES)
        for file in sorted(os.listdir(root / kind / class_name / name))
    ]


def subfolders(folder: Path | str) -> list[str]:
    """Names of the folders in a folder that are not hidden, sorted."""
    return sorted(entry.name for entry in os.scandir(folder) if entry.is_dir() and not entry.name.startswith("."))
