"""WebDataset: tar files whose entries `<number>.<array>.<type>` make one sample for each grasp.

<folder>/<split>-000000.tar, ...    README.md
"""

import io
import json
import tarfile
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from palpate.atomic import atomic_write
from palpate.dataset import Dataset
from palpate.interchange.card import write_card
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
    """Write the grasps of a dataset as WebDataset shards with a data card; atomically. Returns their number.

    arrays: as `Dataset.grasps` takes them. Images are `.png` (an array of several has them numbered), other arrays
    `.npy`; `.json` has object, class, split, grasp. licence, source: as `write_card` takes them. The same run gives
    the same bytes. Raises StoreError if there is no object, KeyError for an unknown array.
    """
    splits, shards = grasps_by_split(dataset, arrays), {}
    with atomic_write(Path(folder)) as partial:
        partial.mkdir()
        for split, grasps in splits.items():
            shards[split], written, tar = 0, shard_bytes, None
            try:
                for number, item in enumerate(with_progress(grasps, split)):
                    if written >= shard_bytes:
                        if tar is not None:
                            tar.close()
                        tar = tarfile.open(partial / f"{split}-{shards[split]:06d}.tar", "w")  # noqa: SIM115
                        shards[split], written = shards[split] + 1, 0
                    for name, content in _entries(item, grasps.images):
                        entry = tarfile.TarInfo(f"{number:08d}.{name}")
                        entry.size = len(content)
                        tar.addfile(entry, io.BytesIO(content))
                        written += len(content)
            finally:
                if tar is not None:
                    tar.close()
        files = {split: f"{split}-*.tar" for split in splits}
        write_card(partial / "README.md", dataset, next(iter(splits.values())), files, licence, source)
    return sum(map(len, splits.values()))


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
