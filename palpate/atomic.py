"""Outputs that appear whole or not at all, whenever the process is killed."""

import os
import re
import secrets
import shutil
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from palpate import seal

# `.partial-<machine>~<process>~<random>-<name>`, and the same with `replaced`: no two writers share one.
TEMPORARY = re.compile(r"\.(?:partial|replaced)-(?P<machine>[^~]*)~(?P<process>\d+)~[0-9a-f]+-(?P<name>.+)")


@contextmanager
def atomic_write(path: Path | str, made_from: seal.MadeFrom | None = None) -> Iterator[Path]:
    """A temporary path beside `path` for a file or a folder, renamed to `path` when the block succeeds, with its
    suffix. Whatever stood at `path` is replaced; if the block raises, it is as before. What killed processes of this
    machine left of the same path is removed first. made_from: seal the output (`palpate.seal`); no file ever is where
    the seal beside it is of another. Raises FileNotFoundError if the block wrote nothing."""
    path = Path(path)
    mark = seal.beside(path)
    owner = f"{machine()}~{os.getpid()}~{secrets.token_hex(4)}"
    partial, replaced = (path.with_name(f".{what}-{owner}-{path.name}") for what in ("partial", "replaced"))
    partial_mark = path.with_name(f".partial-{owner}-{mark.name}")
    path.parent.mkdir(parents=True, exist_ok=True)
    for name in os.listdir(path.parent):
        match = TEMPORARY.fullmatch(name)
        mine = match and match["name"] in (path.name, mark.name) and match["machine"] == machine()
        if match and mine and not is_alive(match["process"]):
            remove(path.parent / name)
    try:
        yield partial
        if not os.path.lexists(partial):
            raise FileNotFoundError(f"{path}: nothing was written to its temporary path {partial}")
        if made_from is not None:
            seal.write(partial, made_from, name=path.name, place=partial_mark)
        # Renaming replaces files only. Of a file with a seal beside it, the old one goes before the new seal comes.
        if os.path.lexists(path) and (path.is_dir() or partial.is_dir() or mark.exists() or partial_mark.exists()):
            os.replace(path, replaced)
        if partial_mark.exists():
            os.replace(partial_mark, mark)
        else:
            mark.unlink(missing_ok=True)
        os.replace(partial, path)
    finally:
        for temporary in (partial, partial_mark, replaced):
            remove(temporary)


def write_if_changed(path: Path, text: str, made_from: seal.MadeFrom | None = None) -> None:
    """Write a text file atomically, unless it holds this text already; made_from: with a seal, unless it has that."""
    try:
        same = path.read_text(encoding="utf-8", errors="replace") == text
        if same and (made_from is None or seal.verify(path).made_from == made_from):
            return
    except (OSError, seal.DamagedFile):
        pass
    with atomic_write(path, made_from) as partial:
        partial.write_text(text, encoding="utf-8")


def machine() -> str:
    """This machine's name, as it stands in file names."""
    return re.sub(r"[^A-Za-z0-9.-]", "_", socket.gethostname())[:64]


def is_alive(process: int | str) -> bool:
    """Whether a process of this machine exists, by its number."""
    try:
        os.kill(int(process), 0)
    except ProcessLookupError:
        return False
    except PermissionError:  # another user's
        pass
    return True


def sweep(folder: Path, whole: re.Pattern[str]) -> list[Path]:
    """Remove what killed processes of any machine left below a folder, and return the removed paths. Nothing may be
    writing there. Folders whose name matches `whole` are outputs: they are not looked into."""
    removed = []
    for place, folders, files in os.walk(folder):
        for path in [Path(place, name) for name in [*folders, *files] if TEMPORARY.fullmatch(name)]:
            remove(path)
            removed.append(path)
        folders[:] = [name for name in folders if not TEMPORARY.fullmatch(name) and not whole.fullmatch(name)]
    return removed


def remove(path: Path) -> None:
    """Remove a file or a folder with all in it, if it exists."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
