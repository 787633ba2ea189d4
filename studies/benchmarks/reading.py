"""Grasps a second that one core reads of a run, and memory and time that `palpate.Dataset` takes on a large run.

    python -m studies.benchmarks.reading results/demo [--seconds 5] [--profile]
    python -m studies.benchmarks.reading [--objects 100000] [--batch-size 16] [--batches 1000] [--reads 5000]

With a run: grasps with all of their arrays, drawn at random, so that nothing read before helps but what a `Dataset`
remembers. The files are in the system's memory after the first pass, which is not counted. Beside it, the same values
by zarr and h5py as they are, without a look at the files' state.

Without: a large run is simulated with tiny arrays. Catalogue and tables of rejections are of all objects; stores of the
first batches have names of their own, the others are links to the first, as only their existence is looked at. Memory
is the process's resident set, in MB, beyond that of the imports. All times are of the processor.
"""

import argparse
import cProfile
import pstats
import random
import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import zarr
from tqdm import tqdm

from palpate import store
from palpate.dataset import Dataset, GraspDataset, run
from palpate.sensor import DIGIT
from palpate.stages import DATASET_STORES
from palpate.store import CONTRACT, files

# What the contract's symbols stand for, small: the number of chunks is that of a real store.
SIZES = {"o": 16, "g": 5, "n": 4, "j": 16, "l": 21, "r": 2, "c": 2, "rc": 4, "p": 2, "s": 4, "k": 1, "b": 3}
ATTRIBUTES = {"seed": 0, "made_from": {}, "sensor": DIGIT.description()}


def read_plainly(run: Path, dataset: Dataset, grasps: GraspDataset, number: int) -> dict[str, np.ndarray]:
    """The arrays of one grasp as the stores have them, by zarr and h5py alone."""
    number, grasp = divmod(number, dataset.grasps_per_object)
    record, values, opened = dataset[number], {}, {}
    for name, (stage, spec) in grasps.sources.items():
        path = run / CONTRACT[stage].path(record.batch)
        if stage not in opened:
            opened[stage] = h5py.File(path) if path.suffix == ".h5" else zarr.open_group(path, mode="r")
        names = [each.decode() if isinstance(each, bytes) else each for each in opened[stage]["object"][:]]
        index = (names.index(record.name), *([grasp] if spec.of_grasps else []), *([0] if spec.of_cameras else []))
        values[name] = opened[stage][spec.name][index]
    return values


def rate(read: Callable[[int], object], length: int, seconds: float) -> float:
    """Calls a second of the processor's time, with numbers drawn at random below `length`."""
    draw, start, count = random.Random(0), time.process_time(), 0
    while (took := time.process_time() - start) < seconds:
        read(draw.randrange(length))
        count += 1
    return count / took


def read_run(folder: Path, seconds: float, profile: bool) -> None:
    """Print how fast a run is read."""
    dataset = Dataset(folder)
    grasps = dataset.grasps()
    size = sum(value.nbytes for value in grasps[0].values() if isinstance(value, np.ndarray))
    print(f"{len(grasps)} grasps of {len(dataset)} objects: {len(grasps.arrays)} arrays, {size / 1e6:.2f} MB each")
    for number in range(len(grasps)):
        grasps[number]
    print(f"{rate(grasps.__getitem__, len(grasps), seconds):.0f} grasps a second by Dataset.grasps()")
    plainly = rate(lambda number: read_plainly(folder, dataset, grasps, number), len(grasps), seconds)
    print(f"{plainly:.0f} grasps a second by zarr and h5py as they are")
    if profile:
        with cProfile.Profile() as profiled:
            rate(grasps.__getitem__, len(grasps), seconds)
        pstats.Stats(profiled).sort_stats("tottime").print_stats(25)


def simulate(folder: Path, objects: int, batch_size: int, batches: int) -> None:
    """Write a run of empty readings and black images: names are right, values are 0."""
    names = [f"mug-{number:06d}" for number in range(objects)]
    of_batch = [names[start : start + batch_size] for start in range(0, objects, batch_size)]
    folder.mkdir(parents=True)
    with (folder / "catalogue.csv").open("w") as file:
        file.write("object,class,split,batch,source,checksum\n")
        for number, members in enumerate(of_batch):
            file.writelines(f"{name},mug,train,batch-{number:04d},mug/{name}.obj,{'0' * 64}\n" for name in members)
    for stage in DATASET_STORES:
        (folder / "rejected" / stage).mkdir(parents=True)
        spec, sizes = CONTRACT[stage], SIZES | {"o": batch_size}
        arrays = {}
        for name, each in spec.arrays.items():
            shape = [sizes.get(axis, axis) for axis in each.shape]
            arrays[name] = np.zeros(shape, "U10" if each.dtype == "string" else each.dtype)
        for number, members in enumerate(tqdm(of_batch, desc=stage, disable=None)):
            (folder / f"rejected/{stage}/batch-{number:04d}.csv").write_text("object,stage,reason\n")
            path, first = folder / spec.path(f"batch-{number:04d}"), folder / spec.path("batch-0000")
            if number == 0 or (number < batches and spec.stage.suffix == ".h5"):
                store.write(path, stage, arrays | {"object": np.array(members)}, ATTRIBUTES)
            elif number < batches and len(members) == batch_size:
                shutil.copytree(first, path)
                zarr.open_group(path, mode="r+")["object"][:] = np.array(members, dtype=object)
                files.seal(path)
            else:
                path.symlink_to(first)


def resident() -> float:
    """MB that the process has in memory."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6


def read_large_run(objects: int, batch_size: int, batches: int, reads: int) -> None:
    """Print memory and time of a large simulated run."""
    with tempfile.TemporaryDirectory() as place:
        simulate(Path(place) / "run", objects, batch_size, batches)
        before, start = resident(), time.process_time()
        dataset = Dataset(Path(place) / "run")
        print(f"opened: {len(dataset)} objects, {resident() - before:.0f} MB, {time.process_time() - start:.1f} s")
        readable = dataset[: min(batches * batch_size, len(dataset))]
        grasps = readable.grasps(arrays=["depth", "reading", "occluded", "palm_pose", "surface_points"])
        draw = random.Random(0)
        for part in range(1, 6):
            start = time.process_time()
            for _ in range(reads // 5):
                grasps[draw.randrange(len(grasps))]
            took = (time.process_time() - start) / (reads // 5) * 1e3
            print(f"{part * reads // 5} grasps read: {resident() - before:.0f} MB, {took:.1f} ms each")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path, nargs="?", help="without: a simulated large one")
    parser.add_argument("--seconds", type=float, default=5)
    parser.add_argument("--profile", action="store_true", help="print the functions that take most")
    for name, default in (("objects", 100_000), ("batch-size", 16), ("batches", 1000), ("reads", 5000)):
        parser.add_argument(f"--{name}", type=int, default=default, help="of the simulated run")
    parser.add_argument("--remembered", type=int, default=run.REMEMBERED_STORES, help="stores whose headers are kept")
    args = parser.parse_args()
    run.REMEMBERED_STORES = args.remembered
    if args.run:
        read_run(args.run, args.seconds, args.profile)
    else:
        read_large_run(args.objects, args.batch_size, args.batches, args.reads)


if __name__ == "__main__":
    main()
