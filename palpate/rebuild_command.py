"""The commands that messages name: with the config of the run that they are about, so that they work as they stand."""

import os
import re
import shlex
from itertools import chain
from pathlib import Path

RECORD = "config.yaml"  # in a run's folder: the config that it was last started with
MARKS = (RECORD, "catalogue.csv", "meshes", "models", "evaluations")  # a run has one of them
BATCHES = "batches.json"  # in the folder of every run that the workflow has started, and in no other
IN_PROGRESS = ("identity", "last.ckpt")  # of a training, which no rule makes
REJECTED = "rejected"  # in a run's folder: a folder a stage, a table a batch
BRACES = re.compile(r"[\w./-]*\{\d+\.\.\d+\}[\w./-]*")  # as bash counts them up: batch-{0000..0012}


def run_folder(path: Path | str) -> Path:
    """The run's folder that a path is in, or is: the nearest that looks like one; if none does, the one that a folder
    of such a name in the path would be in; else that of a store at the path."""
    path = Path(os.path.abspath(path))
    places = [path, *path.parents]
    if path.parts[-3:-2] == (REJECTED,) and not (places[2] / RECORD).exists():
        places = places[3:]  # of rejected/meshes/batch-0000.csv, which is in a folder that has `meshes`
    found = (place for place in places if any((place / mark).exists() for mark in MARKS))
    named = (place.parent for place in places if place.name in MARKS[2:])
    default = path.parent if path.name == "catalogue.csv" else path.parent.parent
    return next(chain(found, named), default if default in places else places[0])


def is_of_run(path: Path | str) -> bool:
    """Whether a path is in the folder of a run that the workflow has started there."""
    return (run_folder(path) / BATCHES).exists()


def label_of(path: Path | str) -> str:
    """A path of a run from the run's folder on, as `touch/batch-0000.zarr`."""
    return os.path.relpath(os.path.abspath(path), run_folder(path))


def rebuild_command(path: Path | str, *targets: str) -> str:
    """The command that makes a file of a run, or targets (braces are the shell's), from the project's root."""
    folder = run_folder(path)
    asked = targets or (os.path.relpath(os.path.abspath(path), folder),)
    record = folder / RECORD
    config = shlex.quote(str(record)) if record.is_file() else f"<the config of the run in {folder}>"
    words = [each if BRACES.fullmatch(each) else shlex.quote(each) for each in asked]
    return f"snakemake {' '.join(words)} --cores 2 --configfile {config}"


def rebuild_advice(path: Path | str, what: str = "it") -> str:
    """How to make a missing or damaged file of a run, as the end of a message; what: the file, for `it`."""
    path, there = Path(path), os.path.lexists(path)
    if path.name in (RECORD, BATCHES):  # batches are then formed anew, and those that differ are made again
        return f"{f'remove {what} and ' if there else ''}start the run again, which writes it"
    if path.name in IN_PROGRESS:
        return f"remove {path.parent} to train from the start"
    start = f"remove {what} and build it again" if there else f"build {what}"
    return f"{start} with: {rebuild_command(path)}"
