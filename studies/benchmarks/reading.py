"""Grasps a second that one core reads of a run.

    python -m studies.benchmarks.reading results/demo [--seconds 5]

Grasps have all of their arrays and are drawn at random, so that nothing read before helps but what a `Dataset`
remembers. The files are in the system's memory after the first pass, which is not counted. Beside it, the same values
by zarr and h5py as they are, without a look at the files' state. Times are of the processor.
"""

import argparse
import random
import time
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import zarr

from palpate.dataset import Dataset, GraspDataset
from palpate.store import CONTRACT


def read_plainly(run: Path, dataset: Dataset, grasps: GraspDataset, number: int) -> dict[str, np.ndarray]:
    """The arrays of one grasp as the stores have them, by zarr and h5py alone."""
    number, grasp = divmod(number, len(dataset[0].grasps))
    record, values, opened = dataset[number], {}, {}
    for name, (stage, spec) in grasps.sources.items():
        path = run / CONTRACT[stage].path(record.batch)
        if stage not in opened:
            opened[stage] = h5py.File(path) if path.suffix == ".h5" else zarr.open_group(path, mode="r")
        names = [stored.decode() if isinstance(stored, bytes) else stored for stored in opened[stage]["object"][:]]
        index = (names.index(record.name), *([grasp] if "g" in spec.shape else []), *([0] if spec.of_cameras else []))
        values[name] = opened[stage][spec.name][index]
    return values


def rate(read: Callable[[int], object], length: int, seconds: float) -> float:
    """Calls a second of the processor's time, with numbers drawn at random below `length`."""
    draw, start, count = random.Random(0), time.process_time(), 0
    while (took := time.process_time() - start) < seconds:
        read(draw.randrange(length))
        count += 1
    return count / took


def main() -> None:
    """Print grasps a second, by `Dataset` and by zarr and h5py alone."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path)
    parser.add_argument("--seconds", type=float, default=5)
    args = parser.parse_args()
    dataset = Dataset(args.run)
    grasps = dataset.grasps()
    size = sum(value.nbytes for value in grasps[0].values() if isinstance(value, np.ndarray))
    print(f"{len(grasps)} grasps of {len(dataset)} objects: {len(grasps.arrays)} arrays, {size / 1e6:.2f} MB each")
    for number in range(len(grasps)):
        grasps[number]
    print(f"{rate(grasps.__getitem__, len(grasps), args.seconds):.0f} grasps a second by Dataset.grasps()")
    plainly = rate(lambda number: read_plainly(args.run, dataset, grasps, number), len(grasps), args.seconds)
    print(f"{plainly:.0f} grasps a second by zarr and h5py as they are")


if __name__ == "__main__":
    main()
