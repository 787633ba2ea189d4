"""Times to write a batch's stores, and their sizes, by compression.

    python -m studies.benchmarks.store results/<run> [--batch batch-0000] [--repeats 3]

Uses the arrays of a batch of a built run. Times are medians, in ms of processor time an object; sizes in kB an object.
"""

import argparse
import os
import tempfile
import time
from functools import partial
from pathlib import Path
from unittest.mock import patch

os.environ.setdefault("OMP_NUM_THREADS", "1")

from tabulate import tabulate

from palpate import store
from palpate.sensor import DIGIT
from palpate.store import zarr_files
from studies.timing import interleaved

# Codec, level and shuffle of Blosc; level 0 stores.
CODECS = [("zstd", 0, "noshuffle"), ("lz4", 1, "shuffle"), ("zstd", 1, "noshuffle"), ("zstd", 1, "shuffle")]
CODECS += [("zstd", 1, "bitshuffle"), *(("zstd", level, "shuffle") for level in (3, 5, 9))]


def size(path: Path) -> int:
    """Bytes of a file, or of all files in a folder."""
    return path.stat().st_size if path.is_file() else sum(f.stat().st_size for f in path.rglob("*") if f.is_file())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path)
    parser.add_argument("--batch", default="batch-0000")
    parser.add_argument("--repeats", type=int, default=3)
    args = parser.parse_args()
    stages = [stage for stage, spec in store.CONTRACT.items() if (args.run / spec.path(args.batch)).exists()]
    arrays = {stage: store.read(args.run / store.CONTRACT[stage].path(args.batch)) for stage in stages}
    objects = len(arrays[stages[0]]["object"])
    attributes = {"made_from": {}, "seed": 0, "sensor": DIGIT.description()}
    print(f"{args.run} {args.batch}: {objects} objects; median of {args.repeats}")
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name, level, shuffle in CODECS:
            found = []
            with patch.object(zarr_files, "COMPRESSION", {"cname": name, "clevel": level, "shuffle": shuffle}):
                for stage in stages:
                    path = Path(folder) / store.CONTRACT[stage].path(args.batch)
                    write = partial(store.write, path, stage, arrays[stage], attributes)
                    spent = interleaved({"it": write}, args.repeats, clock=time.process_time)["it"].seconds
                    found.append((1e3 * spent / objects, size(path) / 1e3 / objects))
            found.append(tuple(map(sum, zip(*found, strict=True))))
            label = f"{name} {level}, {shuffle}" if level else "none"
            rows.append([label, *(f"{spent:.1f} / {kilobytes:.0f}" for spent, kilobytes in found)])
    print(tabulate(rows, ["compression", *(f"{stage}, ms / kB" for stage in [*stages, "all"])], "github"))


if __name__ == "__main__":
    main()
