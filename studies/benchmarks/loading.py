"""Processor time a grasp of torch's DataLoader on a run, beside webdataset's reader of its export; two workers each.

    palpate export results/demo shared --arrays reading success occluded
    python -m studies.benchmarks.loading results/demo shared

Ours are drawn at random, webdataset's shard by shard. webdataset is not locked: `pip install webdataset`.
"""

import argparse
import resource
import time
from pathlib import Path
from statistics import median

import numpy as np
from torch.utils.data import DataLoader, RandomSampler

from palpate.dataset import Dataset

WORKERS, BATCH, GRASPS, ROUNDS = 2, 8, 400, 3
ARRAYS = "reading", "success", "occluded"


def processor() -> float:
    """Seconds so far of this process and of its ended children."""
    return sum(sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


def arrays(sample: dict) -> dict:
    """The arrays of a sample of webdataset, by name."""
    return {name: np.asarray(values) for name, values in sample.items() if name.endswith((".npy", ".png"))}


def main() -> None:
    """Print milliseconds a grasp and cores used by both readers."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", help="its folder")
    parser.add_argument("export", type=Path, help="of the run, as WebDataset")
    args = parser.parse_args()
    import webdataset

    grasps, shards = Dataset(args.run).grasps(arrays=ARRAYS), sorted(map(str, args.export.glob("*.tar")))
    samples = webdataset.WebDataset(shards * GRASPS, shardshuffle=False).decode("rgb8").map(arrays)
    readers = {
        "palpate": DataLoader(grasps, BATCH, sampler=RandomSampler(grasps, True, GRASPS), num_workers=WORKERS),
        "webdataset": DataLoader(samples.with_epoch(GRASPS // WORKERS), BATCH, num_workers=WORKERS),
    }
    rounds: dict[str, list] = {name: [] for name in readers}
    for name, reader in [*readers.items()] * ROUNDS:
        started, before = time.perf_counter(), processor()
        count = sum(len(next(iter(batch.values()))) for batch in reader)
        used = processor() - before
        rounds[name].append((1e3 * used / count, used / (time.perf_counter() - started)))
    for name, measured in rounds.items():
        used, cores = map(median, zip(*measured, strict=True))
        print(f"{name}: {used:.1f} ms of the processor a grasp, {cores:.1f} cores busy")


if __name__ == "__main__":
    main()
