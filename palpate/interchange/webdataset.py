"""WebDataset: tar files whose entries `<number>.<array>.<type>` make one sample for each grasp.

<folder>/<split>-000000.tar, ...    grasps.csv: split, sample, object, class, grasp
         and what every export has: palpate.interchange.folder
"""

import csv
import io
import json
import tarfile
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from palpate.dataset import Dataset
from palpate.interchange.folder import export_folder
from palpate.interchange.items import TEXT, grasps_by_split, pictures, png, with_progress

SHARD_BYTES = 500_000_000  # of a tar file, after which the next one begins


def write_webdataset(
    dataset: Dataset,
    folder: Path | str,
    arrays: Iterable[str] | None = None,
    licence: str = "unknown",
    source: str = "",
    shard_bytes: int = SHARD_BYTES,
) -> int:
    """Write the grasps of a dataset as WebDataset shards, and what every export has; atomically. Returns their number.

    arrays: as `Dataset.grasps` takes them. Images are `.png` (an array of several has them numbered), other arrays
    `.npy`; `.json` has object, class, split, grasp. licence, source: as `write_card` takes them. The same run gives
    the same bytes. Raises StoreError if there is no object, KeyError for an unknown array, and what `export_folder`
    raises.
    """
    splits, sample = grasps_by_split(dataset, arrays), 0
    with (
        export_folder(folder, dataset, splits, "{}-*.tar", licence, source) as partial,
        (partial / "grasps.csv").open("w", encoding="utf-8", newline="") as file,
    ):
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["split", "sample", "object", "class", "grasp"])
        for split, grasps in splits.items():
            shards, written, tar = 0, shard_bytes, None
            try:
                for item in with_progress(grasps, split):
                    if written >= shard_bytes:
                        if tar is not None:
                            tar.close()
                        tar = tarfile.open(partial / f"{split}-{shards:06d}.tar", "w")  # noqa: SIM115
                        shards, written = shards + 1, 0
                    for name, content in _entries(item, grasps.images):
                        entry = tarfile.TarInfo(f"{sample:08d}.{name}")
                        entry.size = len(content)
                        tar.addfile(entry, io.BytesIO(content))
                        written += len(content)
                    table.writerow([split, f"{sample:08d}", item["object"], item["class"], item["grasp"]])
                    sample += 1
            finally:
                if tar is not None:
                    tar.close()
    return sample


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
