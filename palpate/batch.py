"""Processing of a batch of objects, shared by all stages: seeds, rejections, progress, errors in one line."""

import errno
import hashlib
import logging
import mmap
import os
import re
import resource
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tqdm import tqdm

from palpate.seal import DamagedFile, MadeFrom
from palpate.text_files import read_rows, write_rows

log = logging.getLogger(__name__)

# Lack of memory in the words of libigl, pymeshlab, embree, Blender, torch and the system.
NO_MEMORY = re.compile(
    r"bad_alloc|out of (?:\w+ )?memory|not enough memory|(?:can't|cannot|could not|unable to|failed to) allocate", re.I
)
NO_SPACE = re.compile(rf"{os.strerror(errno.ENOSPC)}|errno = {errno.ENOSPC}\b")
FULL = 1 << 20  # bytes: a disk with less free space is full
SPARE = 2 << 30  # bytes that a process must be able to get before an engine's failure counts against an object


class UnusableObject(ValueError):
    """Raised by a stage for an object that it cannot use; the message is the reason in `rejected.csv`."""


class Rejection(NamedTuple):
    """An object that a stage could not use: a row of `rejected.csv`."""

    object: str
    stage: str
    reason: str


def generator(seed: int, *names: str) -> np.random.Generator:
    """A random generator that depends on the run's seed and on names (object, stage, ...) only, not on the batch."""
    digest = hashlib.sha256("\0".join((str(seed), *names)).encode()).digest()
    return np.random.default_rng(np.frombuffer(digest, dtype=np.uint32))


def one_line_error(error: BaseException) -> str:
    """An error in one line, with the remedy for those of the machine: a full disk, no right to write, no memory."""
    text = " ".join(str(error).split())
    if lacks_memory(error):
        return f"too little memory{f' ({text})' if text else ''}: start again with fewer --cores, or free some memory"
    if place := full_disk(error):
        folder = next(folder for folder in Path(os.path.abspath(place)).parents if folder.exists())
        lacking = "it takes no more files (inodes): remove some" if _free(folder) < 0 else "free some space"
        return f"{place}: the disk is full: {lacking} and start again; what is finished stays"
    if isinstance(error, OSError):
        place = error.filename or os.getcwd()
        if error.errno in (errno.EROFS, errno.EACCES, errno.EPERM):
            return f"{place}: {error.strerror}: give the right to it, or set `results` in the config to another folder"
    return f"{type(error).__name__}: {text}"


def full_disk(error: BaseException) -> str:
    """A path on the disk that an error, also of HDF5, reports as full; empty for any other error."""
    if getattr(error, "errno", None) not in (errno.ENOSPC, errno.EDQUOT) and not NO_SPACE.search(str(error)):
        return ""
    named = re.search(r"filename = '([^']+)'", str(error))
    path = getattr(error, "filename", None) or (named and named[1])
    places = [os.getcwd(), tempfile.gettempdir()]  # of an error without a path: where jobs write
    return str(path or next((place for place in places if _free(place) < FULL), places[0]))


def _free(place: Path | str) -> int:
    """Free bytes of a disk; -1 of one that takes no more files."""
    state = os.statvfs(place)
    return -1 if state.f_files and not state.f_favail else state.f_bavail * state.f_frsize


def lacks_memory(error: BaseException | None) -> bool:
    """Whether an error, or its cause, is lack of memory, also in an engine's own words."""
    if error is None:
        return False
    by_type = isinstance(error, MemoryError) or getattr(error, "errno", None) == errno.ENOMEM
    return by_type or bool(NO_MEMORY.search(str(error))) or lacks_memory(error.__cause__)


def require_memory(failure: str) -> bool:
    """Raise MemoryError if less than `SPARE` can be had after a failure that does not name its cause. Lifts the
    process's own limit as far as allowed, and returns whether that changed it: then try again."""
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (hard, hard))
    try:
        mmap.mmap(-1, SPARE, flags=mmap.MAP_PRIVATE).close()
    except OSError:
        raise MemoryError(f"{failure}, and less than {SPARE >> 30} GiB can be had") from None
    return soft != hard


def progress(items: Iterable[Any] | None = None, **options: Any) -> tqdm:
    """A bar of progress on a terminal, with the options of tqdm. A run that shows its own has set TQDM_DISABLE."""
    return tqdm(items, disable="TQDM_DISABLE" in os.environ or None, **options)


def each_object(
    objects: Iterable[str], function: Callable[[str], Any], stage: str
) -> tuple[dict[str, Any], list[Rejection]]:
    """Apply `function` to every object of a batch; one that fails is rejected and the batch goes on. Returns the
    results by object, in order, and the rejections. The message of `UnusableObject` is the reason; any other
    exception's traceback goes to the log too, and memory is checked first (`require_memory`). Raises OSError,
    `palpate.seal.DamagedFile`, and MemoryError, also in an engine's words: these errors are not the object's fault."""
    objects = list(objects)
    results, rejections = {}, []
    for position, name in enumerate(progress(objects, desc=stage, unit="object"), start=1):
        reached = f"{stage} {position}/{len(objects)}: {name}"
        try:
            results[name] = _twice_if_in_doubt(function, name)
            log.info(reached)
        except Exception as error:
            if isinstance(error, OSError | DamagedFile) or lacks_memory(error) or full_disk(error):
                log.error("%s was not finished", reached)
                if place := full_disk(error):
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), place) from error
                if isinstance(error, OSError | DamagedFile | MemoryError):
                    raise
                raise MemoryError(f"{stage} of {name}: {error}") from error
            expected = isinstance(error, UnusableObject)
            rejections.append(Rejection(name, stage, str(error) if expected else f"{type(error).__name__}: {error}"))
            log.warning("%s rejected: %s", reached, error)
    return results, rejections


def _twice_if_in_doubt(function: Callable[[str], Any], name: str) -> Any:
    """The function's result for an object; tried again if a failure may be lack of memory."""
    try:
        return function(name)
    except (UnusableObject, OSError, DamagedFile):
        raise
    except Exception as error:
        if lacks_memory(error):
            raise
        log.exception("%s failed", name)
        if not require_memory(f"{name}: {type(error).__name__}: {error}"):
            raise
    log.info("%s is tried again without a limit of memory", name)
    return function(name)


def read_rejections(paths: Iterable[Path | str]) -> list[Rejection]:
    """The rejections in files that `write_rejections` wrote, in order. Raises `DamagedFile` for a bad file."""
    rows = (row for path in paths for row in read_rows(path, Rejection._fields))
    return [Rejection(*(row[field] for field in Rejection._fields)) for row in rows]


def write_rejections(path: Path | str, rejections: Iterable[Rejection], made_from: MadeFrom | None = None) -> None:
    """Write the columns object, stage, reason, as `palpate.text_files.write_rows`; if none is rejected, only these."""
    write_rows(path, Rejection._fields, rejections, made_from)
