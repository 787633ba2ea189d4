"""Whether a batch's source files are those that its table was made from: checksums decide, and not times.

    <results>/<run>/catalogue/.<batch>.json    `state`, and `files`: sizes and times of each object's, when it was read

Only files with other sizes or times are read again.
"""

import contextlib
import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from palpate.atomic import write_if_changed
from palpate.catalogue.source import CatalogueError
from palpate.catalogue.table import checksum, companions, read_catalogue
from palpate.named_files import HEAD, unusable

Files = Mapping[str, Sequence[Path]]  # of each object by name: its mesh file, and those that this names
Stamps = Mapping[str, Sequence[Sequence[int]]]


def mesh_files(path: Path, root: Path | str) -> list[Path]:
    """A mesh file with the materials, textures and buffers that it names; empty for what can't be a mesh's file.

    Of a long OBJ only the head is read for them, at every start; the catalogue's checksums read all of it.
    """
    if unusable(path):
        return []
    return [path, *(Path(os.path.normpath(path.parent / name)) for name in companions(path, root, HEAD))]


def stamps(files: Files) -> Stamps:
    """Size, time of change, and ctime, which no copy keeps, of each object's files."""
    stats = {name: [os.stat(file) for file in paths if file.exists()] for name, paths in files.items()}
    return {name: [[each.st_size, each.st_mtime_ns, each.st_ctime_ns] for each in of] for name, of in stats.items()}


def state(folder: Path | str, batch: str, files: Files, root: Path | str) -> str:
    """What the batch's job takes as a param: the one that its table was made with, as long as the files are the same.

    Else a digest of what they hold. Empty if no table says what they were. folder: the run's. root: of the sources.
    """
    try:
        made = json.loads(_record(folder, batch).read_text())
        before, stamped = made["state"], made["files"]
        known = {each.object: each.checksum for each in read_catalogue(Path(folder, f"catalogue/{batch}.csv"))}
    except (OSError, ValueError, KeyError, TypeError):
        return ""
    now = stamps(files)
    others = {name: "" for name in files if stamped.get(name) != now[name]}
    for name in others:
        with contextlib.suppress(CatalogueError, OSError, IndexError):  # of a file that is gone, or can't be a mesh's
            others[name] = checksum(files[name][0], root)
    if any(known.get(name) != digest for name, digest in others.items()):
        return hashlib.sha256(json.dumps(others).encode()).hexdigest()
    if others:
        with contextlib.suppress(OSError):  # a dry run on a folder of somebody else's
            write_state(folder, batch, before, now)
    return before


def write_state(folder: Path | str, batch: str, state: str, files: Stamps) -> None:
    """Keep what `state` compares. files: `stamps`, of before the checksums of the batch's table were taken."""
    write_if_changed(_record(folder, batch), json.dumps({"state": state, "files": files}) + "\n")


def _record(folder: Path | str, batch: str) -> Path:
    return Path(folder, f"catalogue/.{batch}.json")
