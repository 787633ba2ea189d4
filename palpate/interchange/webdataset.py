"""WebDataset: tar files whose entries `<number>.<array>.<type>` make one sample for each grasp.

<folder>/<split>-000000.tar, ...    grasps.csv: split, sample, object, class, grasp
         and what every export has: palpate.interchange.folder
"""

import csv
import io
import itertools
import json
import tarfile
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from palpate.dataset import GraspDataset
from palpate.interchange.items import TEXT, Layout, pictures, png, with_progress

SHARD_BYTES = 500_000_000  # of a tar file, after which the next one begins


def write_webdataset(folder: Path, splits: Mapping[str, GraspDataset]) -> None:
    """Write the grasps of each split: images as `.png` (several of an array are numbered), other arrays as `.npy`."""
    samples = itertools.count()
    with (folder / f"{next(iter(splits.values())).units}.csv").open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["split", "sample", "object", "class", next(iter(splits.values())).unit])
        for split, grasps in splits.items():
            shards, written = itertools.count(), SHARD_BYTES
            with ExitStack() as shard:
                for item, sample in zip(with_progress(grasps, split), samples, strict=False):
                    if written >= SHARD_BYTES:
                        shard.close()
                        path = folder / f"{split}-{next(shards):06d}.tar"
                        # All names are short ASCII: this format needs no headers for others.
                        tar = shard.enter_context(tarfile.open(path, "w", format=tarfile.USTAR_FORMAT))
                        written = 0
                    for name, content in _entries(item, grasps):
                        entry = tarfile.TarInfo(f"{sample:08d}.{name}")
                        entry.size = len(content)
                        tar.addfile(entry, io.BytesIO(content))
                        written += len(content)
                    table.writerow([split, f"{sample:08d}", item["object"], item["class"], item[grasps.unit]])


def _entries(item: dict[str, Any], grasps: GraspDataset) -> Iterable[tuple[str, bytes]]:
    """Name and content of each file of a sample."""
    yield "json", json.dumps({name: item[name] for name in (*TEXT, grasps.unit)}, ensure_ascii=False).encode()
    for name in grasps.arrays:
        images = pictures(grasps, name, item[name])
        if not images:
            file = io.BytesIO()
            np.save(file, item[name])
            yield f"{name}.npy", file.getvalue()
        for key, image in images.items():
            yield f"{key}.png", png(image)


def _names(name: str, images: list[str]) -> list[str]:
    """The files that hold an array of a sample."""
    return [f"{image}.png" for image in images] or [f"{name}.npy"]


LAYOUT = Layout("webdataset", write_webdataset, "{}-*.tar", _names)
