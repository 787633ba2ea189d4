"""Outputs that appear whole or not at all, whenever the process is killed."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from palpate.checksums import sidecar, write_sidecar


@contextmanager
def atomic_write(path: Path | str, checksum: bool = False) -> Iterator[Path]:
    """A temporary path beside `path` for a file or a folder, renamed to `path` when the block succeeds.

    The temporary name keeps the suffix, because many writers go by it. Whatever stood at `path` is replaced;
    what a killed run left behind is removed first. If the block raises, `path` is as it was before.
    checksum: keep the file's checksum beside it, which `palpate.checksums.read_text` reads it by.
    Raises FileNotFoundError if the block wrote nothing.
    """
    path = Path(path)
    partial = path.with_name(f".partial-{path.name}")
    replaced = path.with_name(f".replaced-{path.name}")
    path.parent.mkdir(parents=True, exist_ok=True)
    for leftover in (partial, replaced):
        remove(leftover)
    try:
        yield partial
        if not os.path.lexists(partial):
            raise FileNotFoundError(f"{path}: nothing was written to its temporary path {partial}")
        if os.path.lexists(path) and (path.is_dir() or partial.is_dir()):  # renaming replaces files only
            os.replace(path, replaced)
        sidecar(path).unlink(missing_ok=True)  # first: a file is never beside the checksum of another
        os.replace(partial, path)
        if checksum:
            write_sidecar(path)
    finally:
        remove(partial)
        remove(replaced)


def remove(path: Path) -> None:
    """Remove a file or a folder with all in it; nothing happens if there is none."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
