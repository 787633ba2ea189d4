"""What users specify for objects in a CSV file: class, split, up axis, scale, and files that are left out.

    path,class,split,up,scale,exclude
    002_master_chef_can,can,test,,,        a file or a folder below the source's path: all meshes in it
    mugs/blue.glb,,train,y,0.001,
    mugs/blue_old.glb,,,,,yes

An empty field specifies nothing. Of several rows the one of the longest path counts, field by field.
"""

import csv
import os
import unicodedata
from pathlib import Path, PurePosixPath
from typing import NamedTuple

from palpate.catalogue.split import SPLITS
from palpate.configuration import ConfigError

COLUMNS = ("path", "class", "split", "up", "scale", "exclude")
EXCLUDE = {"yes": "yes", "true": "yes", "1": "yes", "x": "yes", "no": "no", "false": "no", "0": "no", "": ""}
MOST_BYTES = 1 << 28  # of the file: a million rows have less


class Given(NamedTuple):
    """What is specified for an object; an empty string where nothing is."""

    class_name: str = ""
    split: str = ""
    up: str = ""
    scale: str = ""
    exclude: str = ""

    def over(self, other: "Given") -> "Given":
        """Field by field this one's, or the other's where this one is empty."""
        return Given(*(mine or theirs for mine, theirs in zip(self, other, strict=True)))


class ObjectTable(dict[str, Given]):
    """The rows of a file, by path relative to the source's."""

    @property
    def gives_classes(self) -> bool:
        """Whether an object's class may be another than its folder says."""
        return any(given.class_name for given in self.values())

    @property
    def excludes(self) -> bool:
        """Whether files may be left out."""
        return any(given.exclude == "yes" for given in self.values())

    def of(self, path: str, class_name: str) -> Given:
        """What is specified for a mesh file; class_name: its class if no row gives it another."""
        given = Given()
        for place in (path, *map(str, PurePosixPath(path).parents)) if self else ():
            given = given.over(self.get(place, given))
        return given._replace(class_name=given.class_name or class_name)


def read_object_table(path: Path | str, root: Path | str) -> ObjectTable:
    """The rows of a CSV file in UTF-8, with a header: `path`, and any of `COLUMNS`.

    root: the source's path, which `path` is relative to, or lies below.
    Raises ConfigError, naming file, line and remedy, for a file that is missing or has another form, a value that can't
    be, a path that does not exist, or two rows about one thing.
    """
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
    unknown = sorted(set(header) - set(COLUMNS))
    if unknown or "path" not in header or len(set(header)) < len(header):
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
        split, up, scale, exclude = (values.get(name, "") for name in COLUMNS[2:])
        if split not in ("", *SPLITS):
            raise ConfigError(f"{place}: split {split!r}: expected {', '.join(SPLITS)}, or nothing")
        if up not in ("", "x", "y", "z"):
            raise ConfigError(f"{place}: up {up!r}: expected x, y, z, or nothing")
        if scale not in ("", "diagonal", "keep") and not _is_scale(scale):
            raise ConfigError(
                f"{place}: scale {scale!r}: expected diagonal, keep, metres a unit of the file (0.001), or nothing"
            )
        if exclude.lower() not in EXCLUDE:
            raise ConfigError(f"{place}: exclude {exclude!r}: expected yes, no, or nothing")
        name = unicodedata.normalize("NFC", values.get("class", ""))
        table[key] = Given(name, split, up, scale, EXCLUDE[exclude.lower()])
    return table


def _is_scale(text: str) -> bool:
    """Whether a text is a number of metres a unit, as the config's schema has it."""
    try:
        return text[0].isdigit() and 0 < float(text) <= 1e6
    except ValueError:
        return False


def _relative(text: str, root: Path, place: str) -> str:
    try:
        path = Path(os.path.normpath(root / Path(text).expanduser()))
        relative = path.relative_to(os.path.normpath(root)).as_posix()
    except (ValueError, RuntimeError):
        raise ConfigError(f"{place}: {text} is not below {root}: paths are relative to source.path") from None
    if not path.exists():  # as macOS writes names, or as others do
        forms = (unicodedata.normalize(form, relative) for form in ("NFC", "NFD"))
        if existing := [each for each in forms if os.path.exists(os.path.join(root, each))]:
            return existing[0]
        raise ConfigError(f"{place}: {path}: no such file or folder: correct the path, or remove the line")
    return relative
