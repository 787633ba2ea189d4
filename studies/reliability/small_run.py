"""The real workflow on one object a split, as `config/smoke.yaml` has them, in a folder of its own."""

import hashlib
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import yaml

from palpate.evaluation import rows
from palpate.inference import checkpoints
from palpate.rebuild_command import RECORD
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

    def start(self, *arguments: str, log: Path) -> subprocess.Popen:
        """Snakemake for `TARGETS`, in a process group of its own; what it prints is added to a file."""
        command = [sys.executable, "-m", "snakemake", *TARGETS, *arguments, "--configfile", str(self.config)]
        with open(log, "a") as output:
            return subprocess.Popen(command, cwd=PROJECT, stdout=output, stderr=output, start_new_session=True)

    def contents(self) -> dict[str, str]:
        """SHA-256 of all that the run made, by path; of a model that of its weights, of an evaluation without times."""
        found = {}
        for path in (path for path in sorted(self.folder.rglob("*")) if path.is_file()):
            name = path.relative_to(self.folder)
            if name.parts[0] not in OF_THE_WAY and not path.name.startswith(".snakemake"):
                found[str(name)] = hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(self.folder.glob("models/*/seed-*/best.ckpt")):
            weights = checkpoints.read(path, "reconstruction")["weights"]
            digest = hashlib.sha256(b"".join(weights[name].numpy().tobytes() for name in sorted(weights)))
            found[str(path.relative_to(self.folder))] = digest.hexdigest()
        for path in sorted(self.folder.glob("evaluations/*/seed-*.csv")):
            errors = rows.read([path]).drop(columns="seconds", errors="ignore").to_csv()
            found[str(path.relative_to(self.folder))] = hashlib.sha256(errors.encode()).hexdigest()
        return found


def small_run(folder: Path, name: str) -> SmallRun:
    """A run in `folder/name`, of which nothing is made yet."""
    config = yaml.safe_load((PROJECT / "config/smoke.yaml").read_text())
    config |= {"run": name, "results": str(folder)}
    config["training"]["device"] = "cpu"  # on a cluster, `auto` asks for a GPU
    path = folder / f"{name}.yaml"
    path.write_text(yaml.safe_dump(config, sort_keys=False))
    return SmallRun(folder / name, path)


def finish(run: SmallRun, *arguments: str, log: Path) -> None:
    """Make all of a run; RuntimeError with the end of its output if that fails."""
    if run.start(*arguments, log=log).wait():
        raise RuntimeError(f"the run in {run.folder} failed:\n" + "\n".join(log.read_text().splitlines()[-20:]))


def differences(run: SmallRun, expected: dict[str, str]) -> Sequence[str]:
    """Paths of what is missing, or another, or should not be there."""
    found = run.contents()
    return sorted(path for path in {*found, *expected} if found.get(path) != expected.get(path))


def processes_of(group: int) -> list[int]:
    """The processes of a session that was started with `start`, jobs too: Snakemake's own, and those it started."""
    listed = subprocess.run(["ps", "-s", str(group), "-o", "pid="], capture_output=True, text=True)
    return [int(number) for number in listed.stdout.split()]
