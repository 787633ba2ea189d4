"""The catalogue: one row an object, with its split, its batch and the checksum of what it is made from."""

import hashlib
import io
import json
import logging
import re
import sys
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import unquote

from palpate.catalogue.batches import assign_batches, in_order
from palpate.catalogue.sources import CatalogueError, Count, SourceObject, given_splits, scan
from palpate.catalogue.split import PAPER_SPLIT, SPLITS, assign_split, suggest_split
from palpate.checksums import DamagedFile, read_rows
from palpate.released import layout
from palpate.remedy import command

log = logging.getLogger(__name__)

COLUMNS = ("object", "class", "split", "batch", "source", "checksum")


class CatalogueEntry(NamedTuple):
    """One object's row of `catalogue.csv`; the fields are `COLUMNS`, in their order.

    source: its mesh file, relative to the source's path. checksum: see `checksum`.
    """

    object: str
    class_name: str
    split: str
    batch: str
    source: str = ""
    checksum: str = ""


def read_catalogue(path: Path | str) -> list[CatalogueEntry]:
    """The rows of a `catalogue.csv`, or of one batch's, in their order.

    Raises CatalogueError, naming the file and the remedy, if it is missing, no text, not as it was written, has no
    rows, or lacks a value of object, class, split or batch.
    """
    if not Path(path).is_file():
        raise CatalogueError(f"{path} does not exist; name a run's folder, or build it with: {command(path)}")
    again = f"remove it and build it with: {command(path)}"
    try:
        rows = read_rows(path, COLUMNS[:4], again)
    except DamagedFile as error:
        raise CatalogueError(str(error)) from None
    entries = [
        # Class, split and batch are one text for all rows that share them: a run may have 100,000 objects.
        CatalogueEntry(
            row["object"],
            *(sys.intern(row[column]) for column in COLUMNS[1:4]),
            *(row.get(column, "") for column in COLUMNS[4:]),
        )
        for row in rows
    ]
    if not entries:
        raise CatalogueError(f"{path} lists no object; {again}")
    for number, entry in enumerate(entries, start=2):
        if "" in entry[:4]:
            raise CatalogueError(f"{path} lacks a value in line {number}; {again}")
    return entries


def splits_of(
    entries: Iterable[SourceObject], source: Mapping[str, Any], ratios: Mapping[str, float]
) -> dict[str, str]:
    """The split of each object by name: the source's own, or that of its name."""
    given = given_splits(source)
    return {entry.object: given.get(entry.object) or assign_split(entry.object, ratios) for entry in entries}


def check_splits(splits: Mapping[str, str], needed: Iterable[str], what: str, by_name: bool = True) -> None:
    """Raise CatalogueError if a split that is needed has none of the objects.

    splits: of each object. what: needs them, as the message names it. by_name: names decide the splits, so that the
    message can say how to set the config's. Rejections come later and are not known here.
    """
    counts = Counter(splits.values())
    empty = [split for split in needed if not counts[split]]
    if not empty:
        return
    message = (
        f"no object of this run is in the {' or '.join(empty)} split, which {what} needs "
        f"({', '.join(f'{split} {counts[split]}' for split in SPLITS)}): "
    )
    better = suggest_split(splits) if by_name else None
    if better:
        text = ", ".join(f"{split}: {share}" for split, share in better.items())
        raise CatalogueError(f"{message}set `split: {{{text}}}` in the config, or add objects (`classes`)")
    raise CatalogueError(f"{message}add objects (`classes`)")


def build(
    source: Mapping[str, Any],
    classes: Mapping[str, Count],
    ratios: Mapping[str, float] = PAPER_SPLIT,
    batches: Mapping[str, str] | int = 16,
):
    """The catalogue as a pandas DataFrame with `COLUMNS`, a row an object, batch by batch in the order of `scan`.

    batches: the batch of each object by name, or a batch's size, by which they are formed anew.
    Splits are those that the source gives, or else go by the names. `source` is the mesh file relative to the
    source's path, so that the table is the same on every machine.
    Raises `CatalogueError` as `scan` does, and where a file that it lists does not exist (procedural objects
    must have been written).
    """
    import pandas  # slow to import, and the only place that needs it

    root = Path(source["path"])
    entries = scan(source, classes)
    splits = splits_of(entries, source, ratios)
    if isinstance(batches, int):
        batches = assign_batches([entry.object for entry in entries], batches)
    rows = [
        (
            entry.object,
            entry.class_name,
            splits[entry.object],
            batches[entry.object],
            entry.source,
            checksum(root / entry.source),
        )
        for entry in in_order(entries, batches)
    ]
    table = pandas.DataFrame(rows, columns=list(COLUMNS))
    _warn_of_empty_splits(table, ratios)
    return table


def _warn_of_empty_splits(table, ratios):
    for name, rows in table.groupby("class"):
        empty = [split for split, share in ratios.items() if share > 0 and split not in set(rows["split"])]
        if empty:
            log.warning("class %s: none of its %d objects is in %s", name, len(rows), " or ".join(empty))


def checksum(path: Path) -> str:
    """SHA-256 of a mesh file, as `sha256sum` gives it; where the file names others that it needs (materials,
    textures, buffers) and they exist, that of the lines `<sha256>  <name>` of them all, the mesh first."""
    if not path.is_file():
        raise CatalogueError(f"{path}: no such file, though the source lists it: was it moved, or not yet written?")
    names = companions(path)
    own = _digest(path)
    if not names:
        return own
    lines = [f"{own}  {path.name}\n"] + [f"{_digest(path.parent / name)}  {name}\n" for name in names]
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def _digest(path: Path) -> str:
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def companions(path: Path, head: int = -1) -> list[str]:
    """The files, relative to the mesh's folder and sorted, that a mesh file names and that exist: an OBJ's
    material libraries and their textures, a glTF's buffers and images, a COLLADA file's images; of a released
    surface the object's images and scenes.

    head: read only so many bytes of an OBJ, which can be long and names its libraries at the top as a rule;
    -1: all of it.
    """
    suffix = path.suffix.lower()
    if suffix == ".obj":
        libraries = _existing(path.parent, _obj_libraries(path, head))
        names = libraries + [name for library in libraries for name in _textures(path.parent / library)]
    elif suffix == ".gltf":
        names = _gltf_uris(path)
    elif suffix == ".dae":
        text = path.read_text(errors="replace")
        names = [unquote(name) for name in re.findall(r"<init_from>\s*(?:<ref>)?([^<]+?)\s*<", text)]
    elif suffix == ".npy":
        names = layout.files(path)
    else:
        names = []
    return sorted(set(_existing(path.parent, names)))


def _obj_libraries(path: Path, head: int) -> list[str]:
    with open(path, "rb") as file:
        return [
            line[7:].decode(errors="replace").strip()
            for line in (file if head < 0 else io.BytesIO(file.read(head)))
            if line.startswith((b"mtllib ", b"mtllib\t"))
        ]


def _textures(library: Path) -> list[str]:
    """What the map statements may name: options stand before the file, whose name may have spaces."""
    statements = re.findall(
        r"^\s*(?:map_\w+|bump|disp|decal|refl|norm)\s+(.+?)\s*$",
        library.read_text(errors="replace"),
        re.MULTILINE | re.IGNORECASE,
    )
    words = [statement.split(" ") for statement in statements]
    return [" ".join(each[i:]) for each in words for i in range(len(each))]


def _gltf_uris(path: Path) -> list[str]:
    try:
        tree = json.loads(path.read_text(errors="replace"))
        items = [*tree.get("buffers", []), *tree.get("images", [])]
        return [unquote(item["uri"]) for item in items if not item.get("uri", "data:").startswith("data:")]
    except (ValueError, AttributeError, TypeError):
        return []  # damaged: the meshes stage says so


def _existing(folder: Path, names: list[str]) -> list[str]:
    return [name for name in names if name and (folder / name).is_file()]
