"""What users specify for classes and objects in a CSV file: class, split, up axis, scale.

    path,class,split,up,scale
    002_master_chef_can,can,test,,keep      a file or a folder below the source's path: all meshes in it
    mugs/blue.glb,,,z,
    ,pan,train,,0.001                       without a path: all objects of the class

An empty field specifies nothing. Of several rows the one of the longest path counts, field by field; a class's row
comes last.
"""

import csv
import os
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import NamedTuple

from palpate.catalogue.split import SPLITS
from palpate.configuration import ConfigError

COLUMNS = ("path", "class", "split", "up", "scale")
UP = ("x", "y", "z")
SCALES = ("diagonal", "keep")

Scale = str | float


class Given(NamedTuple):
    """What is specified for an object; an empty string where nothing is."""

    class_name: str = ""
    split: str = ""
    up: str = ""
    scale: Scale = ""

    def over(self, other: "Given") -> "Given":
        """Field by field this one's, or the other's where this one is empty."""
        return Given(*(mine or theirs for mine, theirs in zip(self, other, strict=True)))


class ObjectTable(NamedTuple):
    """The rows of a file: by path relative to the source's, and by class."""

    of_path: Mapping[str, Given] = {}
    of_class: Mapping[str, Given] = {}

    @property
    def gives_classes(self) -> bool:
        """Whether an object's class may be another than its folder says."""
        return any(given.class_name for given in self.of_path.values())

    def of(self, path: str, class_name: str) -> Given:
        """What is specified for a mesh file; class_name: its class if no row gives it another."""
        given = Given()
        for place in (path, *map(str, PurePosixPath(path).parents)):
            given = given.over(self.of_path.get(place, Given()))
        class_name = given.class_name or class_name
        return given.over(self.of_class.get(class_name, Given()))._replace(class_name=class_name)


def parse_scale(text: str) -> Scale:
    """`diagonal`, `keep`, or metres a unit of the file as a number. Raises ValueError for anything else."""
    if text in SCALES:
        return text
    value = float(text)
    if not 0 < value < float("inf"):
        raise ValueError(text)
    return value


def read_object_table(path: Path | str, root: Path | str) -> ObjectTable:
    """The rows of a CSV file in UTF-8, with a header: `path` or `class` at least, and any of `COLUMNS`.

    root: the source's path, which `path` is relative to, or lies below.
    Raises ConfigError, naming file, line and remedy, for a file that is missing or has another form, a value that can't
    be, a path that does not exist, or two rows about one thing.
    """
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
    unknown = sorted(set(header) - set(COLUMNS))
    if unknown or not {"path", "class"} & set(header) or len(set(header)) < len(header):
        raise ConfigError(
            f"{path}: its header is {', '.join(header) or 'missing'}: expected path or class, and any of "
            f"{', '.join(COLUMNS)}, each once, separated by commas"
        )
    of_path: dict[str, Given] = {}
    of_class: dict[str, Given] = {}
    for line, row in rows:
        place = f"{path}, line {line}"
        if None in row or None in row.values():
            raise ConfigError(f"{place}: {len(header)} fields are expected, as in the header: add or remove commas")
        values = {name: value.strip() for name, value in row.items()}
        if not any(values.values()):
            continue
        given = _given(values, place)
        if values.get("path"):
            table, key = of_path, _relative(values["path"], Path(root), place)
        elif values.get("class"):
            table, key = of_class, values["class"]
        else:
            raise ConfigError(f"{place}: path and class are both empty: fill in one of them")
        if key in table:
            raise ConfigError(f"{place}: there is a line for {key} already: remove one of them")
        table[key] = given
    return ObjectTable(of_path, of_class)


def _given(values: Mapping[str, str], place: str) -> Given:
    split, up = values.get("split", ""), values.get("up", "")
    if split not in ("", *SPLITS):
        raise ConfigError(f"{place}: split {split!r}: expected {', '.join(SPLITS)}, or nothing")
    if up not in ("", *UP):
        raise ConfigError(f"{place}: up {up!r}: expected {', '.join(UP)}, or nothing")
    scale: Scale = values.get("scale", "")
    try:
        scale = parse_scale(scale) if scale else ""
    except ValueError:
        raise ConfigError(
            f"{place}: scale {scale!r}: expected diagonal, keep, or metres a unit of the file (0.001 for millimetres)"
        ) from None
    return Given(values.get("class", ""), split, up, scale)


def _relative(text: str, root: Path, place: str) -> str:
    try:
        path = Path(os.path.normpath(root / Path(text).expanduser()))
        relative = path.relative_to(os.path.normpath(root)).as_posix()
    except (ValueError, RuntimeError):
        raise ConfigError(f"{place}: {text} is not below {root}: paths are relative to source.path") from None
    if not path.exists():
        raise ConfigError(f"{place}: {path}: no such file or folder: correct the path, or remove the line")
    return relative
