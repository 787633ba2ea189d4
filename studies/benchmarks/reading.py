"""Grasps a second that one core reads of a run, each with all of its arrays, and what the time goes to.

    python -m studies.benchmarks.reading results/demo [--seconds 5] [--profile]

Grasps are drawn at random, so that nothing read before helps but what a `Dataset` remembers. The files are in the
system's memory after the first pass, which is not counted. Beside it: the same values by zarr and h5py as they are,
without a look at the files' state, and all chunks of a grasp decoded and nothing else. Times are of the processor.
"""

import argparse
import cProfile
import pstats
import random
import time
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import zarr

from palpate.dataset import Dataset, GraspDataset
from palpate.store import CONTRACT


def plain(run: Path, dataset: Dataset, grasps: GraspDataset, number: int) -> dict[str, np.ndarray]:
    """The arrays of one grasp as the stores have them, by zarr and h5py alone."""
    number, grasp = divmod(number, dataset.grasps_per_object)
    record, values, files = dataset[number], {}, {}
    for name, (stage, spec) in grasps.sources.items():
        path = run / CONTRACT[stage].path(record.batch)
        if stage not in files:
            files[stage] = h5py.File(path) if path.suffix == ".h5" else zarr.open_group(path, mode="r")
        names = [each.decode() if isinstance(each, bytes) else each for each in files[stage]["object"][:]]
        index = (names.index(record.name), *([grasp] if spec.of_grasps else []), *([0] if spec.of_cameras else []))
        values[name] = files[stage][spec.name][index]
    return values


def rate(read: Callable[[int], object], length: int, seconds: float) -> float:
    """Calls a second of the processor's time, with numbers drawn at random below `length`."""
    draw, start, count = random.Random(0), time.process_time(), 0
    while (took := time.process_time() - start) < seconds:
        read(draw.randrange(length))
        count += 1
    return count / took


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path)
    parser.add_argument("--seconds", type=float, default=5)
    parser.add_argument("--profile", action="store_true", help="print the functions that take most")
    options = parser.parse_args()
    dataset = Dataset(options.run)
    grasps = dataset.grasps()
    size = sum(value.nbytes for value in grasps[0].values() if isinstance(value, np.ndarray))
    print(f"{len(grasps)} grasps of {len(dataset)} objects: {len(grasps.arrays)} arrays, {size / 1e6:.2f} MB each")
    for number in range(len(grasps)):
        grasps[number]
    print(f"{rate(grasps.__getitem__, len(grasps), options.seconds):.0f} grasps a second by Dataset.grasps()")
    directly = rate(lambda number: plain(options.run, dataset, grasps, number), len(grasps), options.seconds)
    print(f"{directly:.0f} grasps a second by zarr and h5py as they are")
    if options.profile:
        with cProfile.Profile() as profile:
            rate(grasps.__getitem__, len(grasps), options.seconds)
        pstats.Stats(profile).sort_stats("tottime").print_stats(25)


if __name__ == "__main__":
    main()
