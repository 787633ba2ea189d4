"""Interrupt runs at random moments, continue them, and compare their results with those of an undisturbed run.

    python -m studies.reliability.interrupted [--tries 20] [--seed 0]

Prints the table of docs/evidence/reliability.md. Exits with 1 if anything was lost.
"""

import argparse
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


WAYS: dict[str, Callable[[subprocess.Popen, np.random.Generator], None]] = {
    "kill -9 at a random moment: the run and its jobs, the run alone, or one process": killed,
    "SIGINT (Ctrl-C) at a random moment": interrupted,
}


def interrupt(how: Callable, run: SmallRun, whole: SmallRun, seconds: float, rng: np.random.Generator, tries: int):
    """Interrupt a run `tries` times, up to `seconds` after each start; a list of what each run lost at its end.

    A run that ends before it is interrupted is compared with the whole one, removed, and begun again.
    """
    log, expected, lost, done = run.folder.with_suffix(".log"), whole.contents(), [], 0
    while done < tries or not lost or run.folder.exists():
        process = run.start(*CORES, log=log)
        try:
            process.wait(rng.uniform(1, seconds) if done < tries else None)
        except subprocess.TimeoutExpired:
            how(process, rng)
            process.wait()
            done += 1
            print(f"{how.__name__}: {done} of {tries}", file=sys.stderr, flush=True)
            continue
        finish(run, *CORES, log=log)
        found = list(differences(run, expected))
        lost.append(found + [str(path) for path in run.folder.rglob("*") if TEMPORARY.fullmatch(path.name)])
        shutil.rmtree(run.folder)
    return lost


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tries", type=int, default=20, help="of each way")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="ways with this in their names")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder, rows = Path(name), []
        whole = small_run(folder, "whole")
        start = time.monotonic()
        finish(whole, *CORES, log=folder / "whole.log")
        seconds = (time.monotonic() - start) / 2
        for way, how in WAYS.items():
            if options.only in way:
                run, rng = small_run(folder, how.__name__), generator(options.seed, way)
                lost = interrupt(how, run, whole, seconds, rng, options.tries)
                files = sorted({path for each in lost for path in each})
                rows.append((way, options.tries, len(lost), len(files), ", ".join(files[:3])))
        columns = ["fault", "tried", "runs compared", "files lost or another", "which"]
        print(markdown(pd.DataFrame(rows, columns=columns)))
        sys.exit(int(any(row[3] for row in rows)))


if __name__ == "__main__":
    main()
