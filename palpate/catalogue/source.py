"""The source of a run's meshes: what the config says of it, and a user's table; the layouts of published data sets.

The table is a CSV file of class, split, up axis, scale, and files that are left out:

    path,class,split,up,scale,exclude
    002_master_chef_can,can,test,,,        a file or a folder below the source's path: all meshes in it
    mugs/blue.glb,,train,y,0.001,
    mugs/blue_old.glb,,,,,yes

An empty field specifies nothing. Of several rows the one of the longest path counts, field by field.
"""

import csv
import os
import re
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

from palpate.catalogue.split import SPLITS
from palpate.configuration import ConfigError, absolute, read_yaml
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
    """The section `source` of a checked config."""

    kind: str  # a key of `UP_AXIS`
    path: Path | str  # its folder
    pattern: str | None = None  # of mesh files, in place of those of its layout
    up: str = ""  # the up axis, or `format`; by default that of its kind
    scale: Scale = "diagonal"
    objects: Path | str | None = None  # a CSV file of what the user says of objects
    turned: bool = False  # whether each object is turned about the vertical by an angle of its own
    seed: int = 0  # of these angles

    def __post_init__(self) -> None:
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

    def opened(self) -> "tuple[Path, ObjectTable]":
        """Its folder, and what users say of its objects. Raises CatalogueError if the folder is missing."""
        root = Path(self.path)
        if not root.is_dir():
            raise CatalogueError(f"{root}: no such folder: set source.path to the folder of the {self.kind} source")
        return root, read_object_table(self.objects, self.path) if self.objects else ObjectTable()

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
        """The name of a class's folder. Raises CatalogueError for one of ShapeNet's that `SYNSETS` lacks."""
        if self.kind != "shapenet" or re.fullmatch(r"\d{8}", class_name):
            return class_name
        if class_name not in SYNSETS:
            raise CatalogueError(
                f"class {class_name}: ShapeNet classes known by name are {', '.join(SYNSETS)}; name others by their "
                "synset number (eight digits)"
            )
        return SYNSETS[class_name]


TABLE_COLUMNS = ("path", "class", "split", "up", "scale", "exclude")
EXCLUDE = {"yes": "yes", "true": "yes", "1": "yes", "x": "yes", "no": "no", "false": "no", "0": "no"}
VALUES = {  # of a column: a pattern, and how messages say it; scales are those of the config's schema
    "split": ("|".join(SPLITS), ", ".join(SPLITS)),
    "up": ("[xyz]", "x, y, z"),
    "scale": (
        r"diagonal|keep|(?=[\d.]*[1-9])\d{1,6}(\.\d*)?([eE]-\d\d?)?",
        "diagonal, keep, metres a unit of the file (0.001)",
    ),
    "exclude": ("yes|no", "yes, no"),
}
TABLE_BYTES = 1 << 28  # of the file: a million rows have less


class Given(NamedTuple):
    """What is specified for an object; an empty string where nothing is."""

    class_name: str = ""
    split: str = ""
    up: str = ""
    scale: str = ""
    exclude: str = ""


class ObjectTable(dict[str, Given]):
    """The rows of a file, by path relative to the source's."""

    @property
    def gives_classes(self) -> bool:
        """Whether an object's class may be another than its folder says."""
        return any(given.class_name for given in self.values())

    def of(self, path: str, class_name: str) -> Given:
        """What is specified for a mesh file; class_name: its class if no row gives it another."""
        places = (path, *map(str, PurePosixPath(path).parents)) if self else ()
        rows = [self[place] for place in places if place in self]
        return Given(*(next(filter(None, values), "") for values in zip(*rows, Given(class_name), strict=True)))


def read_object_table(path: Path | str, root: Path | str) -> ObjectTable:
    """The rows of a CSV file in UTF-8 with a header, some of `TABLE_COLUMNS`; root: the source's path. Raises
    ConfigError, naming file, line and remedy, for what can't be, a missing path, or two rows about one thing."""
    if os.path.exists(path) and not (os.path.isfile(path) and os.path.getsize(path) <= TABLE_BYTES):
        raise ConfigError(f"{path}: no file, or over {TABLE_BYTES >> 20} MiB: set source.objects to a CSV file")
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file, skipinitialspace=True)
            header = [(name or "").strip() for name in reader.fieldnames or []]
            reader.fieldnames = header
            rows = [(reader.line_num, row) for row in reader]
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}: set source.objects to a CSV file that exists") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(f"{path}: no CSV file in UTF-8 ({error}): save it as one") from None
    if not {"path"} <= set(header) <= set(TABLE_COLUMNS) or len(set(header)) < len(header):
        raise ConfigError(
            f"{path}: its header is {', '.join(header) or 'missing'}: expected path, and any of "
            f"{', '.join(TABLE_COLUMNS)}, each once, separated by commas"
        )
    table = ObjectTable()
    for line, row in rows:
        place = f"{path}, line {line}"
        if None in row or None in row.values():
            raise ConfigError(f"{place}: {len(header)} fields are expected, as in the header: add or remove commas")
        values = {name: value.strip() for name, value in row.items()}
        if not any(values.values()):
            continue
        if not values["path"]:
            raise ConfigError(f"{place}: the path is empty: fill in that of a mesh file or a folder")
        try:
            full = Path(os.path.normpath(root / Path(values["path"]).expanduser()))
            key = full.relative_to(os.path.normpath(root)).as_posix()
        except (ValueError, RuntimeError):
            raise ConfigError(
                f"{place}: {values['path']} is not below {root}: paths are relative to source.path"
            ) from None
        if not full.exists():  # as macOS writes names, or as others do
            forms = (unicodedata.normalize(form, key) for form in ("NFC", "NFD"))
            key = next((form for form in forms if os.path.exists(os.path.join(root, form))), "")
            if not key:
                raise ConfigError(f"{place}: {full}: no such file or folder: correct the path, or remove the line")
        if key in table:
            raise ConfigError(f"{place}: there is a line for {key} already: remove one of them")
        given = dict.fromkeys(TABLE_COLUMNS, "") | values
        given["class"] = unicodedata.normalize("NFC", given["class"])
        given["exclude"] = EXCLUDE.get(given["exclude"].lower(), given["exclude"])
        for name, (pattern, expected) in VALUES.items():
            if given[name] and not re.fullmatch(pattern, given[name]):
                raise ConfigError(f"{place}: {name} {given[name]!r}: expected {expected}, or nothing")
        table[key] = Given(*(given[name] for name in TABLE_COLUMNS[1:]))
    return table
