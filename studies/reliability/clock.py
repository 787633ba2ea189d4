"""The clock was ahead while the run was made, and is right again: what is changed now looks older than the run."""

import os
import time
from pathlib import Path

import numpy as np

from palpate import store
from palpate.catalogue import read_catalogue
from palpate.dataset.validation import check_again, combine_validation
from studies.reliability.fault import Fault, Try

DAY = 86400.0  # seconds


def _validate(run: Path) -> str:
    """What `snakemake validate` finds wrong, if anything."""
    findings, _ = check_again(run, sorted(run.glob("reports/validation/batch-*.csv")))
    checks = combine_validation(findings, run, run / "sources")
    failed = checks[~checks.passed]
    return "; ".join(f"{each.check}: {each['where']}" for _, each in failed.iterrows())


def source_changed(run: Path, rng: np.random.Generator, tries: int) -> list[Try]:
    """A source file is another, but a day older than all that was made of it: Snakemake makes nothing again."""
    entries, outcomes = read_catalogue(run / "catalogue.csv"), []
    for number in rng.integers(len(entries), size=min(tries, 3)):
        path = run / "sources" / entries[number].source
        content, times = path.read_bytes(), path.stat()
        path.write_bytes(content + b"\n")
        os.utime(path, (time.time() - DAY,) * 2)
        message = _validate(run)
        outcomes.append(Try("validate" if "sources" in message else "silent", message))
        path.write_bytes(content)
        os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
    return outcomes


def store_rebuilt(run: Path, rng: np.random.Generator, tries: int) -> list[Try]:
    """A store is written again with a wrong value, and is older than the report that it passed."""
    paths, outcomes = sorted(run.glob("surface/*.zarr")), []
    for number in rng.integers(len(paths), size=min(tries, 3)):
        path = paths[number]
        attributes, arrays = store.open(path).attributes, store.read(path)
        wrong = arrays["points"].copy()
        wrong[0, rng.integers(wrong.shape[1])] += 1.0
        store.write(path, "surface", arrays | {"points": wrong}, attributes)
        for file in [path, *path.rglob("*")]:
            os.utime(file, (time.time() - DAY,) * 2)
        message = _validate(run)
        outcomes.append(Try("validate" if "inside box" in message else "silent", message))
        store.write(path, "surface", arrays, attributes)
    return outcomes


FAULTS = [
    Fault("clock moved back: a source file changed", source_changed),
    Fault("clock moved back: a store built again", store_rebuilt),
]
