"""Times to write a batch's stores, and their sizes, by compression; and the time of validation.

    python -m studies.benchmarks.store results/<run> [--batch batch-0000] [--repeats 3]

Uses the arrays of a batch of a built run. Times are medians, in ms of processor time an object; sizes in kB an object.
"""

import argparse
import contextlib
import os
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

from palpate import store
from palpate.dataset import Dataset, validation
from palpate.sensor import DIGIT
from palpate.store import files
from studies.timing import interleaved

CODECS = {
    "none": None,
    "lz4 1, shuffle": {"cname": "lz4", "clevel": 1, "shuffle": "shuffle"},
    "zstd 1, noshuffle": {"cname": "zstd", "clevel": 1, "shuffle": "noshuffle"},
    "zstd 1, shuffle": {"cname": "zstd", "clevel": 1, "shuffle": "shuffle"},
    "zstd 1, bitshuffle": {"cname": "zstd", "clevel": 1, "shuffle": "bitshuffle"},
    "zstd 3, shuffle": {"cname": "zstd", "clevel": 3, "shuffle": "shuffle"},
    "zstd 5, shuffle": {"cname": "zstd", "clevel": 5, "shuffle": "shuffle"},
    "zstd 9, shuffle": {"cname": "zstd", "clevel": 9, "shuffle": "shuffle"},
}


def seconds(function: Callable[[], object], repeats: int) -> float:
    """Median processor time of a call, whatever else the machine does."""
    return interleaved({"it": function}, repeats, clock=time.process_time)["it"].seconds


def size(path: Path) -> int:
    """Bytes of a file, or of all files in a folder."""
    return path.stat().st_size if path.is_file() else sum(f.stat().st_size for f in path.rglob("*") if f.is_file())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path)
    parser.add_argument("--batch", default="batch-0000")
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    stages = [s for s, spec in store.CONTRACT.items() if (options.run / spec.path(options.batch)).exists()]
    arrays = {s: store.read(options.run / store.CONTRACT[s].path(options.batch)) for s in stages}
    objects = len(arrays[stages[0]]["object"])
    attributes = {"made_from": {}, "seed": 0, "sensor": DIGIT.description()}

    print(f"{options.run} {options.batch}: {objects} objects; median of {options.repeats}")
    print("| compression | " + " | ".join(f"{s}, ms / kB" for s in stages) + " | all, ms / kB |")
    print("|---|" + "---|" * (len(stages) + 1))
    with tempfile.TemporaryDirectory() as folder:
        for name, codec in CODECS.items():
            cells, total_ms, total_kb = [], 0.0, 0.0
            for stage in stages:
                path = Path(folder) / store.CONTRACT[stage].path(options.batch)
                with compression(codec):
                    call = partial(store.write, path, stage, arrays[stage], attributes)
                    took = seconds(call, options.repeats)
                ms, kb = 1e3 * took / objects, size(path) / 1e3 / objects
                total_ms, total_kb = total_ms + ms, total_kb + kb
                cells.append(f"{ms:.1f} / {kb:.0f}")
            print(f"| {name} | " + " | ".join(cells) + f" | {total_ms:.1f} / {total_kb:.0f} |", flush=True)

    took = seconds(lambda: validation.validate_batch(options.run, options.batch, stages=stages), options.repeats)
    print(f"validation: {1e3 * took / objects:.0f} ms an object")
    dataset = Dataset(options.run)
    print(f"opening: {1e3 * seconds(lambda: Dataset(options.run), options.repeats):.1f} ms")
    readings = dataset.array("touch", "reading")
    len(readings)
    print(f"one grasp's readings: {1e3 * seconds(lambda: readings[1], 20):.1f} ms")


@contextlib.contextmanager
def compression(codec: dict | None):
    """Write with another codec than the library's."""
    chosen = files.COMPRESSION
    files.COMPRESSION = codec or {"cname": "zstd", "clevel": 0, "shuffle": "noshuffle"}  # level 0 stores
    try:
        yield
    finally:
        files.COMPRESSION = chosen


if __name__ == "__main__":
    main()
