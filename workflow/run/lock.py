"""One run at a time in a run's folder: a lock that ends with the process that holds it, however that ends.

The locks are those of `flock(2)`. The system drops them when a process dies, so that a killed run leaves none.
They hold on one machine, and across machines on NFS and on parallel file systems that are mounted with them.

    .lock         held by the run itself; its text says which process on which machine
    .jobs.lock    shared by the run's jobs, on any machine; its text names those that have started
"""

import errno
import fcntl
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import IO

from palpate.atomic import is_alive, machine

LOCK, JOBS_LOCK = ".lock", ".jobs.lock"
# What a file system without such locks answers.
UNSUPPORTED = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)
# Open for as long as this process lives: closing a file drops its lock.
_held: list[IO[str]] = []


class FolderInUse(RuntimeError):
    """Another run uses the folder; the message names its process, its machine, and what to do."""


def hold(folder: Path | str, warn: Callable[[str], None]) -> None:
    """Take a run's folder for this process, until it ends; wait for jobs that a killed run has left.

    warn: gets a line where there is something to know, as that it waits. Raises FolderInUse if another process
    has the folder; OSError if the lock's file can't be written.
    """
    file = open(Path(folder, LOCK), "a+")  # noqa: SIM115 - it stays open
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in UNSUPPORTED:
            warn(f"{folder}: this file system has no locks: do not start a second run in this folder")
        else:
            holder = _text(file)
            file.close()
            raise FolderInUse(
                f"{folder} is in use by another run: {holder or 'a process that has just started'}. Wait until it "
                "ends, or stop it there; or give this run a folder of its own, with --config run=<another name>"
            ) from None
    command = " ".join([Path(sys.argv[0]).name, *sys.argv[1:]])
    file.truncate(0)
    file.write(f"process {os.getpid()} on {machine()}, since {time.strftime('%Y-%m-%d %H:%M:%S')}, {command}\n")
    file.flush()
    _held.append(file)
    _wait_for_jobs(Path(folder), warn)


def share(folder: Path | str) -> None:
    """Mark this process, until it ends, as a job in a run's folder. Without locks nothing happens."""
    file = open(Path(folder, JOBS_LOCK), "a+")  # noqa: SIM115 - it stays open
    try:
        fcntl.flock(file, fcntl.LOCK_SH)
    except OSError as error:
        if error.errno not in UNSUPPORTED:
            raise
    file.write(f"process {os.getpid()} on {machine()}\n")
    file.flush()
    _held.append(file)


def _wait_for_jobs(folder: Path, warn: Callable[[str], None]) -> None:
    """Wait until no job of an earlier run is left, which would write over what this run makes."""
    with open(folder / JOBS_LOCK, "a+") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno not in UNSUPPORTED:
                jobs = [line for line in _text(file).splitlines() if not _has_ended(line)]
                warn(f"{folder}: waiting for jobs of a run that was killed: {', '.join(jobs) or 'on another machine'}")
                fcntl.flock(file, fcntl.LOCK_EX)
        file.truncate(0)


def _has_ended(line: str) -> bool:
    """Whether a line `process <number> on <machine>` names a process of this machine that has ended."""
    words = line.split()
    return len(words) == 4 and words[3] == machine() and words[1].isdigit() and not is_alive(words[1])


def _text(file: IO[str]) -> str:
    """All text of an open file."""
    file.seek(0)
    return file.read().strip()
