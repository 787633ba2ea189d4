"""Processing of a batch of objects, shared by all stages: seeds, rejections, progress."""

import csv
import errno
import gc
import hashlib
import logging
import os
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tqdm import tqdm

from palpate import lock
from palpate.checksums import DamagedFile, read_rows
from palpate.remedy import command

log = logging.getLogger(__name__)

# In a job's environment: a run has the terminal, and jobs print nothing on it. tqdm heeds it too.
QUIET = "TQDM_DISABLE"
# Containers made between two searches for garbage. With Python's own 700 it goes through what modules hold again and
# again while they load, and finds nothing.
GARBAGE_AFTER = 50_000


class UnusableObject(ValueError):
    """Raised by a stage for an object that it cannot use; the message is the reason in `rejected.csv`."""


class Rejection(NamedTuple):
    object: str
    stage: str
    reason: str


def generator(seed: int, *names: str) -> np.random.Generator:
    """A random generator that depends on the run's seed and on names (object, stage, ...) only.

    So a result does not change with the batch size, the number of cores or the order of objects.
    """
    digest = hashlib.sha256("\0".join((str(seed), *names)).encode()).digest()
    return np.random.default_rng(np.frombuffer(digest, dtype=np.uint32))


def log_to(path: Path | str) -> None:
    """Send a job's log lines, what engines print, and the traceback of a failure to its log file.

    The last line of a job that failed is its error in one line (`plain`). Standard error stays on the terminal, for
    the progress bar and for that line.
    The process counts as a job of the run in whose folder it is, until it ends (`palpate.lock`).
    """
    gc.set_threshold(GARBAGE_AFTER)
    if Path(lock.LOCK).exists():
        lock.share(".")
    file = open(path, "w", buffering=1)  # noqa: SIM115 - it lives as long as the process
    logging.basicConfig(stream=file, level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s", force=True)
    logging.captureWarnings(True)
    sys.stdout.flush()
    os.dup2(file.fileno(), 1)

    def excepthook(kind, error, traceback):
        log.critical("stopped", exc_info=(kind, error, traceback))
        said_by_run = QUIET in os.environ
        try:
            print(plain(error), flush=True)
        except OSError:  # a full disk: the run finds nothing in the log
            said_by_run = False
        if not said_by_run:
            print(plain(error), file=sys.stderr)

    sys.excepthook = excepthook


def plain(error: BaseException) -> str:
    """An error in one line, with the remedy where it is the machine's: a full disk, no right to write, no memory."""
    text = " ".join(str(error).split())
    if isinstance(error, MemoryError):
        return f"too little memory{f' ({text})' if text else ''}: start again with fewer --cores, or free some memory"
    if isinstance(error, OSError):
        place = error.filename or os.getcwd()
        if error.errno in (errno.ENOSPC, errno.EDQUOT) or os.strerror(errno.ENOSPC) in text:
            return f"{place}: the disk is full: free some space and start again; what is finished stays"
        if error.errno in (errno.EROFS, errno.EACCES, errno.EPERM):
            return f"{place}: {error.strerror}: give the right to it, or set `results` in the config to another folder"
    return f"{type(error).__name__}: {text}"


def each_object(
    objects: Iterable[str], function: Callable[[str], Any], stage: str
) -> tuple[dict[str, Any], list[Rejection]]:
    """Apply `function` to every object of a batch; one that fails is rejected and the batch goes on.

    Returns the results by object, in order, and the rejections. `UnusableObject` gives its message as the reason;
    any other exception is an error of ours or of an engine: its traceback goes to the log as well. Raises
    OSError, MemoryError and `palpate.checksums.DamagedFile` as they come: a full disk, or a file that was damaged, says
    nothing about the object, which is tried again when the stage is.
    """
    objects = list(objects)
    results, rejections = {}, []
    bar = tqdm(objects, desc=stage, unit="object", disable=not sys.stderr.isatty())
    for position, name in enumerate(bar, start=1):
        try:
            results[name] = function(name)
            log.info("%s %d/%d: %s", stage, position, len(objects), name)
        except UnusableObject as error:
            rejections.append(Rejection(name, stage, str(error)))
            log.warning("%s %d/%d: %s rejected: %s", stage, position, len(objects), name, error)
        except (OSError, MemoryError, DamagedFile):
            log.error("%s %d/%d: %s was not finished", stage, position, len(objects), name)
            raise
        except Exception as error:
            rejections.append(Rejection(name, stage, f"{type(error).__name__}: {error}"))
            log.exception("%s %d/%d: %s failed", stage, position, len(objects), name)
    return results, rejections


def read_rejections(paths: Iterable[Path | str]) -> list[Rejection]:
    """The rejections in files that `write_rejections` wrote, in their order.

    Raises `palpate.checksums.DamagedFile`, naming the file and the remedy, if one is missing or not as it was written.
    """
    rejections = []
    for path in map(Path, paths):
        rows = read_rows(path, Rejection._fields, f"remove it and build it with: {command(path)}")
        rejections += [Rejection(*(row[field] for field in Rejection._fields)) for row in rows]
    return rejections


def write_rejections(path: Path | str, rejections: Iterable[Rejection]) -> None:
    """Write the columns object, stage, reason; the header is there even if nothing was rejected."""
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(Rejection._fields)
        writer.writerows(rejections)
