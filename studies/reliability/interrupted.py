"""Interrupt runs at random moments, continue them, and compare their results with those of an undisturbed run.

    python -m studies.reliability.interrupted [--tries 20] [--seed 0]

Prints the table of docs/evidence/reliability.md. Exits with 1 if anything was lost. Filling a disk needs root.
"""

import argparse
import errno
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from palpate.atomic import TEMPORARY
from palpate.batch import generator
from palpate.results.tables import markdown
from studies.reliability.small_run import SmallRun, differences, finish, processes_of, small_run

CORES = ("--cores", "2")


def killed(process: subprocess.Popen, rng: np.random.Generator) -> None:
    """kill -9: the run with all its jobs, the run alone, or one of its processes."""
    everything = processes_of(process.pid)
    chosen = rng.integers(3)
    for number in (everything, [process.pid], [int(rng.choice(everything))])[chosen]:
        os.kill(number, signal.SIGKILL)


def interrupted(process: subprocess.Popen, rng: np.random.Generator) -> None:
    """Ctrl-C: the terminal sends SIGINT to the run and its jobs."""
    os.killpg(process.pid, signal.SIGINT)


def interrupt(
    how: Callable[[subprocess.Popen, np.random.Generator], None],
    run: SmallRun,
    expected: dict[str, str],
    seconds: float,
    rng: np.random.Generator,
    tries: int,
) -> list[list[str]]:
    """Interrupt a run `tries` times, up to `seconds` after each start; what each run lost at its end.

    A run that ends before it is interrupted is compared, removed, and begun again.
    """
    log, lost, done = run.folder.with_suffix(".log"), [], 0
    while done < tries:
        process = run.start(*CORES, log=log)
        try:
            process.wait(rng.uniform(1, seconds))
        except subprocess.TimeoutExpired:
            how(process, rng)
            process.wait()
            done += 1
            print(f"{how.__name__}: {done} of {tries}", file=sys.stderr, flush=True)
            continue
        lost.append(_end(run, expected, log))
    lost.append(_end(run, expected, log))
    return lost


def _end(run: SmallRun, expected: dict[str, str], log: Path) -> list[str]:
    finish(run, *CORES, log=log)
    found = list(differences(run, expected))
    found += [str(path) for path in run.folder.rglob("*") if TEMPORARY.fullmatch(path.name)]
    run.remove()
    return found


def disk_full(
    folder: Path, expected: dict[str, str], size: int, rng: np.random.Generator, tries: int
) -> list[list[str]]:
    """Runs on a disk that gets full at a random place; then it gets room, and they continue. What each lost.

    size: bytes that a whole run takes.
    """
    lost = []
    disk, log = folder / "disk", folder / "disk.log"
    disk.mkdir()
    for done in range(tries):
        room = int(rng.uniform(0.05, 0.9) * size)
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={room}", "tmpfs", str(disk)], check=True)
        try:
            run = small_run(disk, "run")
            start = log.stat().st_size if log.exists() else 0
            if not run.start(*CORES, log=log).wait():
                raise RuntimeError(f"a run of {size} bytes fitted into {room}")
            output = log.read_text()[start:]
            subprocess.run(["mount", "-o", f"remount,size={4 * size}", str(disk)], check=True)
            named = any(words in output for words in ("the disk is full", os.strerror(errno.ENOSPC)))
            lost.append(_end(run, expected, log) + ([] if named else [f"the full disk is not named in: {output}"]))
        finally:
            subprocess.run(["umount", "--lazy", str(disk)], check=True)
        print(f"disk_full: {done + 1} of {tries}", file=sys.stderr, flush=True)
    return lost


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tries", type=int, default=20, help="of each way")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="ways with this in their names")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        whole = small_run(folder, "whole")
        start = time.monotonic()
        finish(whole, *CORES, log=folder / "whole.log")
        seconds, expected = (time.monotonic() - start) / 2, whole.contents()
        size = sum(path.stat().st_size for path in whole.folder.rglob("*") if path.is_file())
        print(f"whole: {len(expected)} files, {size} bytes, {2 * seconds:.0f} s", file=sys.stderr, flush=True)
        ways = {
            "kill -9 at a random moment: the run and its jobs, the run alone, or one process": killed,
            "SIGINT (Ctrl-C) at a random moment": interrupted,
            "disk full": None,
        }
        if os.geteuid() or not shutil.which("mount"):
            del ways["disk full"]
        rows = []
        for way, how in ways.items():
            if options.only not in way:
                continue
            rng, tries = generator(options.seed, way), min(options.tries, 5) if how is None else options.tries
            if how is None:
                lost = disk_full(folder, expected, size, rng, tries)
            else:
                lost = interrupt(how, small_run(folder, how.__name__), expected, seconds, rng, tries)
            files = sorted({path for each in lost for path in each})
            rows.append((way, tries, len(lost), len(files), ", ".join(files[:3])))
            print(*rows[-1], sep=" | ", file=sys.stderr, flush=True)
        columns = ["fault", "tried", "runs compared", "files lost or another", "which"]
        print(markdown(pd.DataFrame(rows, columns=columns)))
        sys.exit(int(any(row[3] for row in rows)))


if __name__ == "__main__":
    main()
