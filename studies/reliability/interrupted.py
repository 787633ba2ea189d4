"""Interrupt runs at random moments, continue them, and compare their results with those of an undisturbed run.

    python -m studies.reliability.interrupted [--tries 20] [--seed 0]

The runs are the real workflow on one object a split, as `config/smoke.yaml` has them. Prints the table of
docs/evidence/reliability.md. Exits with 1 if anything was lost.
"""

import argparse
import hashlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import yaml

from palpate.atomic import TEMPORARY
from palpate.batch import generator
from palpate.learning import checkpoints, rows
from palpate.rebuild_command import RECORD
from palpate.results.tables import markdown
from workflow.run.lock import JOBS_LOCK, LOCK

PROJECT = Path(__file__).parents[2]
# The data with their tables and figures, and a model with its evaluation.
TARGETS = ("dataset", "evaluations/charts_occluded_touch/seed-0.csv")
# Records of how a run went: times, places, processes. Models and evaluations have some too.
OF_THE_WAY = (".snakemake", "logs", "benchmarks", LOCK, JOBS_LOCK, RECORD, "models", "evaluations")


class SmallRun(NamedTuple):
    """A run: its folder, and its config's file beside it."""

    folder: Path
    config: Path

    def start(self) -> subprocess.Popen:
        """Snakemake for `TARGETS`, in a process group of its own; what it prints is added to a file by the folder."""
        options = ["--cores", "2", "--configfile", str(self.config)]
        with open(self.folder.with_suffix(".log"), "a") as log:
            command = [sys.executable, "-m", "snakemake", *TARGETS, *options]
            return subprocess.Popen(command, cwd=PROJECT, stdout=log, stderr=log, start_new_session=True)

    def finish(self) -> None:
        """Make all of it; RuntimeError with the end of its output if that fails."""
        if self.start().wait():
            last = "\n".join(self.folder.with_suffix(".log").read_text().splitlines()[-20:])
            raise RuntimeError(f"the run in {self.folder} failed:\n{last}")

    def contents(self) -> dict[str, str]:
        """SHA-256 of all that the run made, by path; of a model that of its weights, of an evaluation without times."""
        contents = {}
        for path in (path for path in sorted(self.folder.rglob("*")) if path.is_file()):
            name = path.relative_to(self.folder)
            if name.parts[0] not in OF_THE_WAY and not path.name.startswith(".snakemake"):
                contents[str(name)] = path.read_bytes()
        for path in self.folder.glob("models/*/seed-*/best.ckpt"):
            weights = checkpoints.read(path, "reconstruction")["weights"]
            contents[str(path.relative_to(self.folder))] = b"".join(
                weights[x].numpy().tobytes() for x in sorted(weights)
            )
        for path in self.folder.glob("evaluations/*/seed-*.csv"):
            errors = rows.read([path]).drop(columns="seconds", errors="ignore").to_csv()
            contents[str(path.relative_to(self.folder))] = errors.encode()
        return {name: hashlib.sha256(content).hexdigest() for name, content in contents.items()}


def small_run(folder: Path, name: str) -> SmallRun:
    """A run in `folder/name`, of which nothing is made yet."""
    config = yaml.safe_load((PROJECT / "config/smoke.yaml").read_text())
    config |= {"run": name, "results": str(folder)}
    config["training"]["device"] = "cpu"  # on a cluster, `auto` asks for a GPU
    path = folder / f"{name}.yaml"
    path.write_text(yaml.safe_dump(config, sort_keys=False))
    return SmallRun(folder / name, path)


def killed(process: subprocess.Popen, rng: np.random.Generator) -> None:
    """kill -9: the run with all its jobs, the run alone, or one of its processes."""
    listed = subprocess.run(["ps", "-s", str(process.pid), "-o", "pid="], capture_output=True, text=True)
    everything = [int(number) for number in listed.stdout.split()]  # Snakemake's own, and those it started
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
    """Interrupt a run `tries` times, up to `seconds` after each start; returns a list of what each run lost at its end.

    A run that ends before it is interrupted is compared with the whole one, removed, and begun again.
    """
    expected, lost, done = whole.contents(), [], 0
    while done < tries or not lost or run.folder.exists():
        process = run.start()
        try:
            process.wait(rng.uniform(1, seconds) if done < tries else None)
        except subprocess.TimeoutExpired:
            how(process, rng)
            process.wait()
            done += 1
            print(f"{how.__name__}: {done} of {tries}", file=sys.stderr, flush=True)
            continue
        run.finish()
        made = run.contents()
        differ = sorted(path for path in {*made, *expected} if made.get(path) != expected.get(path))
        lost.append(differ + [str(path) for path in run.folder.rglob("*") if TEMPORARY.fullmatch(path.name)])
        shutil.rmtree(run.folder)
    return lost


def main() -> None:
    """Interrupt runs in both ways, and print the table; exits with 1 if anything was lost."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tries", type=int, default=20, help="of each way")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder, table = Path(name), []
        whole = small_run(folder, "whole")
        start = time.monotonic()
        whole.finish()
        seconds = (time.monotonic() - start) / 2
        for way, how in WAYS.items():
            lost = interrupt(
                how, small_run(folder, how.__name__), whole, seconds, generator(options.seed, way), options.tries
            )
            files = sorted({path for paths in lost for path in paths})
            table.append((way, options.tries, len(lost), len(files), ", ".join(files[:3])))
        columns = ["fault", "tried", "runs compared", "files lost or another", "which"]
        print(markdown(pd.DataFrame(table, columns=columns)))
        sys.exit(int(any(row[3] for row in table)))


if __name__ == "__main__":
    main()
