"""Grasps a second that torch's DataLoader reads of a run with two workers, beside webdataset's reader of its export.

    palpate export results/demo shared --arrays reading success occluded
    python -m studies.benchmarks.loading results/demo shared [--grasps 400] [--rounds 3]

Both give batches of 8 grasps, with the arrays that the export has: ours drawn at random, webdataset's shard by shard.
webdataset is not locked: `pip install webdataset`. Processor times are of this process and its workers, so they compare
on a busy machine; the rates do not. Readers take turns. The first round is not counted.

`computing` reads nothing: its workers keep as many cores busy as the machine has to spare.
"""

import argparse
import hashlib
import resource
import tarfile
import time
import warnings
from collections.abc import Iterable
from pathlib import Path
from statistics import median

import numpy as np
from torch.utils.data import DataLoader, RandomSampler

from palpate.dataset import Dataset, GraspDataset

WORKERS, BATCH = 2, 8
BLOCK = 2_000_000  # bytes


def by_palpate(grasps: GraspDataset, number: int) -> Iterable:
    """Batches of grasps drawn at random."""
    sampler = RandomSampler(grasps, replacement=True, num_samples=number)
    return DataLoader(grasps, batch_size=BATCH, sampler=sampler, num_workers=WORKERS)


def by_webdataset(shards: list[str], number: int) -> Iterable:
    """Batches of an export's grasps, shard by shard."""
    import webdataset

    samples = webdataset.WebDataset(shards * number, shardshuffle=False).decode("rgb8").map(_numbers)
    return DataLoader(samples.with_epoch(number // WORKERS), batch_size=BATCH, num_workers=WORKERS)


def by_computing(_: object, number: int) -> Iterable:
    """Batches of numbers that take some milliseconds of the processor each."""
    return DataLoader(Computed(), batch_size=BATCH, sampler=range(number), num_workers=WORKERS)


class Computed:
    """Checksums of a block of zeros."""

    def __getitem__(self, number: int) -> dict[str, int]:
        return {"sum": hashlib.sha256(bytes(BLOCK)).digest()[0]}


def _numbers(sample: dict) -> dict:
    return {name: np.asarray(values) for name, values in sample.items() if name.endswith((".npy", ".png"))}


def measured(batches: Iterable) -> tuple[int, float, float]:
    """Number of grasps, seconds, and seconds of the processor, of reading all batches."""
    started, before, count = time.perf_counter(), _processor(), 0
    for batch in batches:
        count += len(next(iter(batch.values())))
    return count, time.perf_counter() - started, _processor() - before


def _processor() -> float:
    """Processor time so far of this process and of its ended children, seconds."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path)
    parser.add_argument("export", type=Path, help="of the run, as WebDataset")
    parser.add_argument("--grasps", type=int, default=400)
    parser.add_argument("--rounds", type=int, default=3)
    args = parser.parse_args()
    shards = sorted(map(str, args.export.glob("*.tar")))
    warnings.filterwarnings("ignore", "The given NumPy array is not writable")  # webdataset's, in every worker
    with tarfile.open(shards[0]) as tar:
        names = dict.fromkeys(entry.name.split(".")[1] for entry in tar if not entry.name.endswith(".json"))
    grasps = Dataset(args.run).grasps(arrays=names)
    print(f"{len(grasps)} grasps, {WORKERS} workers, arrays: {', '.join(names)}")
    readers = {
        "palpate": (by_palpate, grasps),
        "webdataset": (by_webdataset, shards),
        "computing": (by_computing, None),
    }
    rounds: dict[str, list] = {name: [] for name in readers}
    for _ in range(args.rounds + 1):
        for name, (reader, source) in readers.items():
            rounds[name].append(measured(reader(source, args.grasps)))
    for name, found in rounds.items():
        count, seconds, processor = map(median, zip(*found[1:], strict=True))
        print(
            f"{name}: {count / seconds:.0f} grasps a second, {1e3 * processor / count:.1f} ms of the processor each, "
            f"{processor / seconds:.1f} cores busy"
        )


if __name__ == "__main__":
    main()
