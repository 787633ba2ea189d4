"""Whether a batch's source files are those that its table was made from: checksums decide, and not times.

    <results>/<run>/catalogue/.<batch>.json    `state`, and `files`: sizes and times of each object's when they were read

Only files with other sizes or times are read again.
"""

import contextlib
import hashlib
import json
import os
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path

from palpate.atomic import write_if_changed
from palpate.catalogue.source import CatalogueError
from palpate.catalogue.sources import SourceObject
from palpate.catalogue.table import checksum, companions, read_catalogue
from palpate.named_files import HEAD, unusable

Stamps = Mapping[str, Sequence[Sequence[int]]]


@cache
def mesh_files(path: Path, root: Path | str) -> list[Path]:
    """A mesh file with the materials, textures and buffers that it names; empty for what can't be a mesh's file.

    Of a long OBJ only the head is read for them, at every start; the catalogue's checksums read all of it.
    """
    if unusable(path):
        return []
    return [path, *(Path(os.path.normpath(path.parent / name)) for name in companions(path, root, HEAD))]


def stamps(entries: Iterable[SourceObject], root: Path | str) -> Stamps:
    """Size, time of change, and time of the last change of either (ctime), of each object's files, by its name."""
    found = {}
    for each in entries:
        stats = [os.stat(file) for file in mesh_files(Path(root, each.source), root) if os.path.exists(file)]
        found[each.object] = [[stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns] for stat in stats]
    return found


def state(folder: Path | str, batch: str, entries: Iterable[SourceObject], root: Path | str) -> str:
    """What the batch's job takes as a param: the one that its table was made with, as long as the files are the same.

    Else a digest of what they hold. Empty if no table says what they were. folder: the run's.
    """
    entries, record = list(entries), _record(folder, batch)
    try:
        made = json.loads(record.read_text())
        before, files = made["state"], made["files"]
        known = {each.object: each.checksum for each in read_catalogue(Path(folder, f"catalogue/{batch}.csv"))}
    except (OSError, ValueError, KeyError, TypeError):
        return ""
    now, others = stamps(entries, root), []
    for each in entries:
        if files.get(each.object) != now[each.object]:
            with contextlib.suppress(CatalogueError, OSError):  # a file that is gone: the digest has no line of it
                others.append((each.object, checksum(Path(root, each.source), root)))
    if all(known.get(name) == digest for name, digest in others):
        if others:
            with contextlib.suppress(OSError):
                write_state(folder, batch, before, now)
        return before
    return hashlib.sha256(json.dumps(others).encode()).hexdigest()


def write_state(folder: Path | str, batch: str, state: str, files: Stamps) -> None:
    """Keep what `state` compares. files: `stamps`, of before the checksums of the batch's table were taken."""
    write_if_changed(_record(folder, batch), json.dumps({"state": state, "files": files}) + "\n")


def _record(folder: Path | str, batch: str) -> Path:
    return Path(folder, f"catalogue/.{batch}.json")
