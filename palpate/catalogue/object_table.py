"""What users specify for objects in a CSV file: class, split, up axis, scale, and files that are left out.

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
from pathlib import Path, PurePosixPath
from typing import NamedTuple

from palpate.catalogue.split import SPLITS
from palpate.configuration import ConfigError

COLUMNS = ("path", "class", "split", "up", "scale", "exclude")
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
MOST_BYTES = 1 << 28  # of the file: a million rows have less


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
    """The rows of a CSV file in UTF-8, with a header: `path`, and any of `COLUMNS`; root: the source's path. Raises
    ConfigError, naming file, line and remedy, for what can't be, a path that does not exist, or two rows about one
    thing."""
    if os.path.exists(path) and not (os.path.isfile(path) and os.path.getsize(path) <= MOST_BYTES):
        raise ConfigError(f"{path}: no file, or over {MOST_BYTES >> 20} MiB: set source.objects to a CSV file")
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
    if not {"path"} <= set(header) <= set(COLUMNS) or len(set(header)) < len(header):
        raise ConfigError(
            f"{path}: its header is {', '.join(header) or 'missing'}: expected path, and any of "
            f"{', '.join(COLUMNS)}, each once, separated by commas"
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
        key = _relative(values["path"], Path(root), place)
        if key in table:
            raise ConfigError(f"{place}: there is a line for {key} already: remove one of them")
        given = dict.fromkeys(COLUMNS, "") | values
        given["class"] = unicodedata.normalize("NFC", given["class"])
        given["exclude"] = EXCLUDE.get(given["exclude"].lower(), given["exclude"])
        for name, (pattern, expected) in VALUES.items():
            if given[name] and not re.fullmatch(pattern, given[name]):
                raise ConfigError(f"{place}: {name} {given[name]!r}: expected {expected}, or nothing")
        table[key] = Given(*(given[name] for name in COLUMNS[1:]))
    return table


def _relative(text: str, root: Path, place: str) -> str:
    """A path of the file, relative to the source's. Raises ConfigError, naming the place, if there is none."""
    try:
        path = Path(os.path.normpath(root / Path(text).expanduser()))
        relative = path.relative_to(os.path.normpath(root)).as_posix()
    except (ValueError, RuntimeError):
        raise ConfigError(f"{place}: {text} is not below {root}: paths are relative to source.path") from None
    if not path.exists():  # as macOS writes names, or as others do
        forms = (unicodedata.normalize(form, relative) for form in ("NFC", "NFD"))
        if existing := [form for form in forms if os.path.exists(os.path.join(root, form))]:
            return existing[0]
        raise ConfigError(f"{place}: {path}: no such file or folder: correct the path, or remove the line")
    return relative
