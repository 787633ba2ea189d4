"""Faults of a run's files, each kind of file a row of the table in docs/evidence/reliability.md.

Each kind of file is removed, emptied, cut, zeroed and altered at random places.
"""

import json
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from palpate import mesh, seal, store
from palpate.batch import read_rejections
from palpate.catalogue import read_catalogue
from palpate.dataset.run import Run
from palpate.dataset.validation import check_files, look_at, outputs, read_findings
from palpate.learning import checkpoints, rows
from palpate.learning.loop import HISTORY
from palpate.seal import DamagedFile
from palpate.text_files import read_record

COLUMNS = ("fault", "tried", "by the reader", "by validate", "nothing changed", "lost in silence", "for example")
BLOCK = 4096  # bytes: what file systems write at once, and lose at once


class Try(NamedTuple):
    """The outcome of a fault at one place.

    noticed: `reader` if the step or user who reads it gets an error, `validate` if only `snakemake validate` fails,
    `unchanged` if all that is read is as before, `silent` if it is not and no error says so. message: of the error.
    """

    noticed: str
    message: str = ""


def row(name: str, tries: Sequence[Try], run: Path) -> dict[str, str | int]:
    """One row of the table; the run's path is RUN in its message."""
    counts = [sum(outcome.noticed == who for outcome in tries) for who in ("reader", "validate", "unchanged", "silent")]
    messages = [outcome.message for outcome in tries if outcome.message]
    example = (messages[0] if messages else "").splitlines()[:1]
    return dict(zip(COLUMNS, (name, len(tries), *counts, "".join(example).replace(str(run), "RUN")), strict=True))


class Kind(NamedTuple):
    """One kind of file: its name, where such files are, and what is read of them all, to compare."""

    name: str
    patterns: tuple[str, ...]
    read: Callable[[Path], object]


def _stores(stage: str, run: Path) -> Iterator[object]:
    for batch in Run(run).batches:
        path = run / store.CONTRACT[stage].path(batch)
        yield json.dumps(store.open(path).attributes, sort_keys=True)
        yield from (values.tobytes() for _, values in sorted(store.read(path).items()))


def _meshes(run: Path) -> Iterator[object]:
    for batch in sorted((run / "meshes").glob("batch-*")):
        for name in mesh.usable(batch):
            yield name, mesh.load_visual(batch / name).vertices.tobytes()
            yield from (
                mesh.mesh_file(batch / name, path.name).read_bytes() for path in sorted((batch / name).iterdir())
            )


def _rejections(run: Path) -> Iterator[object]:
    yield from map(tuple, (rejection.items() for rejection in Run(run).rejections()))
    yield from read_rejections([run / "rejected.csv"])


def _masters(run: Path) -> Iterator[object]:
    """Masters, which only users read; `seal.json` says what they must be."""
    yield from (path.read_bytes() for path in sorted(run.glob("exr/*/*.exr")))


def _weights(run: Path) -> Iterator[object]:
    for path in sorted(run.glob("models/**/seed-*")):
        content = checkpoints.read(path / "best.ckpt", "reconstruction")
        yield from (tensor.numpy().tobytes() for tensor in content.pop("weights").values())
        yield repr(content)


def _records(run: Path) -> Iterator[object]:
    for path in sorted(run.glob("models/**/seed-*")):
        yield read_record(path / "training.json")


def _histories(run: Path) -> Iterator[object]:
    for path in sorted(run.glob("models/**/seed-*")):
        yield rows.read_table(path / "history.csv", HISTORY).to_csv()


def _evaluations(run: Path) -> Iterator[object]:
    known = sorted(run.glob(f"evaluations/*/.seed-*.csv.{seal.NAME}"))  # also of one that was removed
    yield rows.read([path.with_name(path.name[1:].removesuffix(f".{seal.NAME}")) for path in known]).to_csv()


def _products(run: Path) -> Iterator[object]:
    """Only users read them, who see that one is gone."""
    for place in sorted([*run.glob(f"tables/.*.{seal.NAME}"), *run.glob(f"figures/.*.{seal.NAME}")]):
        path = place.with_name(place.name[1:].removesuffix(f".{seal.NAME}"))
        if not path.exists():
            raise DamagedFile(f"{path} does not exist")
        yield path.read_bytes()


def _validation(run: Path) -> Iterator[object]:
    for batch in Run(run).batches:
        yield from read_findings(run / f"reports/validation/{batch}.csv")


KINDS = (
    Kind("meshes", ("meshes/*/*/*", "meshes/*/seal.json"), _meshes),
    *(
        Kind(f"{stage} store", (f"{stage}/*.h5", f"{stage}/*.zarr/**/*"), partial(_stores, stage))
        for stage in store.CONTRACT
    ),
    Kind("catalogue.csv", ("catalogue.csv",), lambda run: read_catalogue(run / "catalogue.csv")),
    Kind("rejected csv", ("rejected.csv", "rejected/*/*.csv"), _rejections),
    Kind("EXR masters", ("exr/*/*",), _masters),
    Kind("checkpoint", ("models/*/seed-*/best.ckpt",), _weights),
    Kind("training.json", ("models/*/seed-*/training.json",), _records),
    Kind("history.csv", ("models/*/seed-*/history.csv",), _histories),
    Kind("evaluation csv", ("evaluations/*/seed-*.csv",), _evaluations),
    Kind("table, figure", ("tables/*", "figures/*"), _products),
    Kind("config.yaml", ("config.yaml",), lambda run: [Run(run).config]),
    Kind("seal beside a file", (f".*.{seal.NAME}", f"*/**/.*.{seal.NAME}"), lambda run: []),
    Kind("validation csv", ("reports/validation/batch-*.csv",), _validation),
)


def _zeroed(content: bytes, rng: np.random.Generator) -> bytes:
    """A block of the file is zeros: its size was written, its data not."""
    start = BLOCK * int(rng.integers(-(-len(content) // BLOCK)))
    return content[:start] + bytes(len(content[start : start + BLOCK])) + content[start + BLOCK :]


def _altered(content: bytes, rng: np.random.Generator) -> bytes:
    """One bit of the file is flipped."""
    changed = bytearray(content)
    changed[rng.integers(len(content))] ^= 1 << int(rng.integers(8))
    return bytes(changed)


# What is left of a file's content; None if nothing is there.
DAMAGES: dict[str, Callable[[bytes, np.random.Generator], bytes | None]] = {
    "removed": lambda content, rng: None,
    "emptied": lambda content, rng: b"",
    "cut off": lambda content, rng: content[: rng.integers(len(content))],
    "a block of zeros": _zeroed,
    "a bit altered": _altered,
}


def apply(kind: Kind, damage: Callable, run: Path, rng: np.random.Generator, tries: int) -> list[Try]:
    """Damage files of a kind, one at a time, at random; each is as it was at the end. No file, no tries."""
    paths = {path for pattern in kind.patterns for path in run.glob(pattern) if path.is_file() and path.stat().st_size}
    files = sorted(path for path in paths if not path.name.startswith(".") or path.name.endswith(seal.NAME))
    if not files:
        return []
    expected, outcomes = list(kind.read(run)), []
    for _ in range(tries):
        with restored(files[rng.integers(len(files))]) as (path, content):
            damaged = damage(content, rng)
            path.unlink() if damaged is None else path.write_bytes(damaged)
            outcomes.append(outcome(kind, run, expected))
    return outcomes


@contextmanager
def restored(path: Path) -> Iterator[tuple[Path, bytes]]:
    """A file with its content; afterwards it has this content and its times again."""
    content, times = path.read_bytes(), path.stat()
    yield path, content
    path.write_bytes(content)
    os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))


def outcome(kind: Kind, run: Path, expected: list) -> Try:
    """Who notices that a run is damaged. An error that is not ours, or names no file, counts as `silent`."""
    try:
        unchanged = list(kind.read(run)) == expected
    except Exception as error:  # whatever a damaged file makes a reader trip over
        ours = type(error).__module__.startswith("palpate.") and str(run) in str(error)
        return Try("reader" if ours else "silent", f"{type(error).__name__}: {error}")
    if message := validate(run):
        return Try("validate", message)
    return Try("unchanged" if unchanged else "silent")


def validate(run: Path) -> str:
    """What `snakemake validate` says of a run's files: the first that is not as written; empty if all are."""
    try:
        for batch in Run(run).batches:
            for finding in check_files(Run(run), batch):
                if not finding.ok:
                    return finding.where
        looked_at = (look_at(Run(run), path) for path in outputs(run))
        return next((damage or difference for damage, difference, _ in looked_at if damage or difference), "")
    except ValueError as error:  # of what validation itself reads: catalogue, config, rejections
        return str(error)


def each_damage(kind: Kind, run: Path, rng: np.random.Generator, tries: int) -> list[Try]:
    """Each of `DAMAGES`, `tries` times."""
    return [outcome for damage in DAMAGES.values() for outcome in apply(kind, damage, run, rng, tries)]
