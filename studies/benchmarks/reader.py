"""Memory and time that `palpate.Dataset` takes on a large run, which is simulated with tiny arrays.

    python -m studies.benchmarks.reader [--objects 100000] [--batch-size 16] [--batches 1000] [--reads 5000]
                                       [--remembered 1024]

Catalogue and tables of rejections are of all objects. Stores of the first batches have names of their own; the others'
are links to the first, as nothing but their existence is looked at. Grasps are read at random from the first batches.
Memory is the process's resident set, in MB, beyond that of the imports.
"""

import argparse
import random
import shutil
import tempfile
import time
from pathlib import Path

import numpy as np
import zarr
from tqdm import tqdm

from palpate import store
from palpate.dataset import Dataset, run
from palpate.sensor import DIGIT
from palpate.store import CONTRACT, files

STAGES = ("surface", "grasps", "touch", "vision")
# What the contract's symbols stand for, small: the number of chunks is that of a real store.
SIZES = {"o": 16, "g": 5, "n": 4, "j": 16, "l": 21, "r": 2, "c": 2, "rc": 4, "p": 2, "s": 4, "k": 1, "b": 3}
ATTRIBUTES = {"seed": 0, "made_from": {}, "sensor": DIGIT.description()}


def simulate(folder: Path, objects: int, batch_size: int, batches: int) -> None:
    """Write a run of empty readings and black images: names are right, values are 0."""
    names = [f"mug-{number:06d}" for number in range(objects)]
    of_batch = [names[start : start + batch_size] for start in range(0, objects, batch_size)]
    folder.mkdir(parents=True)
    with (folder / "catalogue.csv").open("w") as file:
        file.write("object,class,split,batch,source,checksum\n")
        for number, members in enumerate(of_batch):
            file.writelines(f"{name},mug,train,batch-{number:04d},mug/{name}.obj,{'0' * 64}\n" for name in members)
    for stage in STAGES:
        (folder / "rejected" / stage).mkdir(parents=True)
        spec = CONTRACT[stage]
        sizes = SIZES | {"o": batch_size}
        arrays = {
            name: np.zeros(
                [sizes.get(axis, axis) for axis in each.shape], "U10" if each.dtype == "string" else each.dtype
            )
            for name, each in spec.arrays.items()
        }
        for number, members in enumerate(tqdm(of_batch, desc=stage, disable=None)):
            (folder / f"rejected/{stage}/batch-{number:04d}.csv").write_text("object,stage,reason\n")
            path, first = folder / spec.path(f"batch-{number:04d}"), folder / spec.path("batch-0000")
            if number == 0 or (number < batches and spec.suffix == ".h5"):
                store.write(path, stage, arrays | {"object": np.array(members)}, ATTRIBUTES)
            elif number < batches and len(members) == batch_size:
                shutil.copytree(first, path)
                zarr.open_group(path, mode="r+")["object"][:] = np.array(members, dtype=object)
                files.seal(path)
            else:
                path.symlink_to(first)


def resident() -> float:
    """MB that the process has in memory."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 1e6


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--objects", type=int, default=100_000)
    parser.add_argument("--batch-size", type=int, default=16)
    parser.add_argument("--batches", type=int, default=1000)
    parser.add_argument("--reads", type=int, default=5000)
    parser.add_argument("--remembered", type=int, default=run.REMEMBERED_STORES, help="stores whose headers are kept")
    options = parser.parse_args()
    run.REMEMBERED_STORES = options.remembered
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "run"
        simulate(folder, options.objects, options.batch_size, options.batches)
        before, start = resident(), time.process_time()
        dataset = Dataset(folder)
        print(f"opened: {len(dataset)} objects, {resident() - before:.0f} MB, {time.process_time() - start:.1f} s")
        readable = dataset[: min(options.batches * options.batch_size, len(dataset))]
        grasps = readable.grasps(arrays=["depth", "reading", "occluded", "palm_pose", "surface_points"])
        draw = random.Random(0)
        for part in range(1, 6):
            start = time.process_time()
            for _ in range(options.reads // 5):
                grasps[draw.randrange(len(grasps))]
            took = (time.process_time() - start) / (options.reads // 5) * 1e3
            print(f"{part * options.reads // 5} grasps read: {resident() - before:.0f} MB, {took:.1f} ms each")


if __name__ == "__main__":
    main()
