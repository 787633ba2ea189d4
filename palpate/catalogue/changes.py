"""Checksums of a batch's source files: they decide whether its table is made again, and times do not.

    <results>/<run>/catalogue/.<batch>.json    of each object its files' sizes and times, and their checksum

Only files with other sizes or times are read again.
"""

import contextlib
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from palpate.atomic import write_if_changed
from palpate.catalogue.source import CatalogueError
from palpate.catalogue.table import checksum, companions
from palpate.named_files import HEAD, unusable


def mesh_files(path: Path, root: Path | str) -> list[Path]:
    """A mesh file with the materials, textures and buffers that it names; empty for what can't be a mesh's file.

    Of a long OBJ only the head is read for them, at every start; the catalogue's checksums read all of it.
    """
    if unusable(path):
        return []
    return [path, *(Path(os.path.normpath(path.parent / name)) for name in companions(path, root, HEAD))]


def source_checksums(known: Path, files: Mapping[str, Sequence[Path]], root: Path | str) -> dict[str, str]:
    """The `checksum` of each object by name; empty for a file that is missing, or can't be a mesh's.

    known: the file that keeps them. files: of each object, as `mesh_files` has them. root: of the sources.
    """
    try:
        before = json.loads(known.read_text())
    except (OSError, ValueError):
        before = {}
    now = {}
    for name, paths in files.items():
        stats = [path.stat() for path in paths if path.exists()]
        stamps = [[stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns] for stat in stats]  # no copy keeps the last
        now[name] = before.get(name, [])
        if now[name][:1] != [stamps]:
            now[name] = [stamps, ""]
            with contextlib.suppress(CatalogueError, OSError, IndexError):
                now[name][1] = checksum(paths[0], root)
    with contextlib.suppress(OSError):  # a dry run on a folder of somebody else's
        write_if_changed(known, json.dumps(now) + "\n")
    return {name: digest for name, (_, digest) in now.items()}
