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

import numpy as np

from palpate.dataset import GraspDataset
from palpate.interchange.items import TEXT, Place, image_names, pictures, png, with_progress

SHARD_BYTES = 500_000_000  # of a tar file, after which the next one begins


def write_webdataset(folder: Path, splits: Mapping[str, GraspDataset]) -> None:
    """Write the grasps of each split: images as `.png` (several of an array are numbered), other arrays as `.npy`."""
    samples = itertools.count()
    with (folder / "grasps.csv").open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["split", "sample", "object", "class", "grasp"])
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
                    for name, content in _entries(item, grasps.images):
                        entry = tarfile.TarInfo(f"{sample:08d}.{name}")
                        entry.size = len(content)
                        tar.addfile(entry, io.BytesIO(content))
                        written += len(content)
                    table.writerow([split, f"{sample:08d}", item["object"], item["class"], item["grasp"]])


def places(grasps: GraspDataset) -> dict[str, Place]:
    """The names of each array's files in a sample."""
    item, found = grasps[0], {}
    for name, images in image_names(grasps).items():
        files = [f"{each}.png" for each in images] or [f"{name}.npy"]
        pattern = f"*.{name}.*.png" if images and images != [name] else f"*.{files[0]}"
        text = " to ".join(f"`{each}`" for each in dict.fromkeys([files[0], files[-1]]))
        found[name] = Place(text, pattern, item[name].shape)
    return found


def _entries(item: dict, images: dict[str, bool]) -> Iterable[tuple[str, bytes]]:
    """Name and content of each file of a sample."""
    described = {name: item[name] for name in (*TEXT, "grasp")}
    yield "json", json.dumps(described, ensure_ascii=False).encode()
    for name, values in item.items():
        if name in described:
            continue
        if name in images:
            for each, image in pictures(name, values, images[name]).items():
                yield f"{each}.png", png(image)
        else:
            file = io.BytesIO()
            np.save(file, values)
            yield f"{name}.npy", file.getvalue()
