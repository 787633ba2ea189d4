"""The source of a run's meshes: what the config says of it, and the layouts of data sets as they are published."""

import re
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from palpate.configuration import absolute, read_yaml
from palpate.mesh import FORMATS
from palpate.released.layout import subfolders

Scale = str | float  # `diagonal`, `keep`, or metres a unit of the file
MESH_SUFFIXES = tuple(f".{suffix}" for suffix in FORMATS)

# ShapeNetCore's folders of the paper's classes (WordNet synset offsets). Others are asked for by their number.
SYNSETS = {"bottle": "02876657", "knife": "03624134", "cellphone": "02992529", "rifle": "04090263"}


class CatalogueError(ValueError):
    """The source lacks what the config requests; the message names the place and the remedy."""


# Where the data sets of a kind have their meshes, and how they stand.
LAYOUTS: dict[str, dict[str, Any]] = read_yaml(Path(__file__).with_name("layouts.yaml"))
# glTF's is y (its specification, section 3.4). COLLADA files say theirs, or have y. Other formats have none, or allow
# any; CAD and scans have z as a rule.
FORMAT_UP = {".glb": "y", ".gltf": "y"}
# The up axis of a source whose config does not say it.
UP_AXIS = {"procedural": "z", "released": "z", **{kind: layout["up"] for kind, layout in LAYOUTS.items()}}


@dataclass(frozen=True)
class Source:
    """The section `source` of a config. Raises CatalogueError for an unknown kind."""

    kind: str  # a key of `UP_AXIS`
    path: Path | str  # its folder
    pattern: str | None = None  # of mesh files, in place of those of its layout
    up: str = ""  # the up axis, or `format`; by default that of its kind
    scale: Scale = "diagonal"
    objects: Path | str | None = None  # a CSV file of what the user says of objects
    turned: bool = False  # whether each object is turned about the vertical by an angle of its own
    seed: int = 0  # of these angles

    def __post_init__(self) -> None:
        if self.kind not in UP_AXIS:
            raise CatalogueError(f"source kind {self.kind!r}: expected one of {', '.join(UP_AXIS)}")
        object.__setattr__(self, "up", self.up or UP_AXIS[self.kind])

    @classmethod
    def from_config(cls, config: Mapping[str, Any], project: Path | str) -> "Source":
        """The source of a checked config, with absolute paths: relative ones are the project's. Procedural objects are
        made in the run's folder. Raises ConfigError as `absolute` does."""
        section = dict(config["source"])
        made_in = Path(absolute(config["results"], project), config["run"], "sources")
        section["path"] = absolute(section["path"], project) if section["path"] else str(made_in)
        section["objects"] = absolute(section["objects"], project) if section.get("objects") else None
        return cls(**section, seed=config.get("seed", 0))

    @property
    def patterns(self) -> list[str]:
        """The patterns of its mesh files, the best first; of kinds with a layout."""
        return [self.pattern] if self.pattern else LAYOUTS[self.kind]["patterns"]

    @property
    def has_class_folders(self) -> bool:
        """Whether the meshes of a class are in a folder of their own."""
        return self.kind in LAYOUTS and all("{class}" in pattern.split("/") for pattern in self.patterns)

    def class_folders(self, place: Path) -> list[str]:
        """Names of the folders of classes in a folder, sorted."""
        return [name for name in subfolders(place) if self.kind != "shapenet" or re.fullmatch(r"\d{8}", name)]

    def class_of(self, folder: str) -> str:
        """The class of a folder's name."""
        names = {synset: name for name, synset in SYNSETS.items()} if self.kind == "shapenet" else {}
        return names.get(folder, unicodedata.normalize("NFC", folder))

    def folder_of(self, class_name: str) -> str:
        """The name of a class's folder. Raises CatalogueError for a name that ShapeNet's synsets are not known by."""
        if self.kind != "shapenet" or re.fullmatch(r"\d{8}", class_name):
            return class_name
        if class_name not in SYNSETS:
            raise CatalogueError(
                f"class {class_name}: ShapeNet classes known by name are {', '.join(SYNSETS)}; name others by their "
                "synset number (eight digits)"
            )
        return SYNSETS[class_name]
