"""How an export's grasps are laid out in files; what every export has is in `palpate.interchange.folder`.

webdataset  <split>-000000.tar, ...                  entries `<sample>.<array>.<type>` make one sample for each grasp
            grasps.csv                               split, sample, object, class, grasp
parquet     <split>/metadata.parquet                 a row a grasp; columns `<array>_file_name` name images
            <split>/<object>/<grasp>/<array>.png     as `datasets.load_dataset(<folder>)` of Hugging Face reads them
zarr        <split>.zarr/<array>                     (grasp, ...): axes have names, as xarray opens them
            <split>.zarr/object, class, split, grasp (grasp,): which grasp of which object
"""

import csv
import io
import itertools
import json
import tarfile
import zlib
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from PIL import Image

from palpate.batch import progress
from palpate.catalogue import SPLITS
from palpate.dataset import Dataset, GraspDataset
from palpate.store.zarr_files import COMPRESSION, load_zarr

CARD = "README.md"
# Keys of an item of `GraspDataset` that are text.
TEXT = ("object", "class", "split")
SHARD_BYTES = 500_000_000  # of a tar file, after which the next one begins
ROWS = 64  # grasps of Parquet that are held in memory before they are written
# Grasps of a chunk of Zarr, which is a file, and in memory before they are written. Zarr takes longer to read a grasp
# by itself from a shard than all 16 of a chunk.
CHUNK = 16


class Layout(NamedTuple):
    """How samples are laid out in files."""

    name: str
    write: Callable[[Path, Mapping[str, GraspDataset]], None]  # the grasps of each split into a folder
    split_files: str  # pattern of a split's files
    # Names of the files or columns that hold an array, by its name and those of its images, if it is of images.
    names: Callable[[str, list[str]], list[str]]


@dataclass(frozen=True)
class Contents:
    """What an export is of, for its card and its description."""

    dataset: Dataset
    splits: Mapping[str, GraspDataset]  # the grasps that are written
    layout: Layout
    licence: str  # as `palpate.interchange.card.spdx` returns it
    source: str  # of the meshes, with their terms, as text, verbatim

    @property
    def grasps(self) -> GraspDataset:
        """Those of the first split, whose arrays all splits have."""
        return next(iter(self.splits.values()))

    @cached_property
    def example(self) -> dict[str, Any]:
        """The first grasp, whose arrays have the shapes of all."""
        return self.grasps[0]


def samples_by_split(
    dataset: Dataset, arrays: Iterable[str] | None, samples: str = "grasps"
) -> Mapping[str, GraspDataset]:
    """The grasps or presses of each split that has objects. Raises what `Dataset.grasps` raises."""
    filled = [split for split in SPLITS if split in {record.split for record in dataset}]
    if samples == "presses":
        return {split: dataset.presses(split, dataset.presses(arrays=arrays).arrays) for split in filled}
    camera = None if "vision" in dataset.stages and len(dataset) and dataset[0].cameras > 1 else 0
    whole = dataset.grasps(arrays=arrays, camera=camera)  # the same arrays in each split, an error without objects
    return {split: dataset.grasps(split, whole.arrays, camera) for split in filled}


def versions(dataset: Dataset) -> dict[str, str]:
    """Versions of what made the first object's stores, palpate first."""
    made_by: dict[str, str] = {}
    for stage in dataset.stages:
        made_by |= dataset.array(stage, "object").attrs["versions"]
    return made_by


def pictures(grasps: GraspDataset, name: str, values: np.ndarray) -> dict[str, np.ndarray]:
    """The images of an array by name, `reading.0`, `reading.1`, ..., or the array's if it is one image.
    values: (..., h, w), of colours (..., h, w, 3 or 4). Empty for an array that is not of images."""
    if name not in grasps.images:
        return {}
    shape = values.shape[-3 if grasps.images[name] else -2 :]
    if values.shape == shape:
        return {name: values}
    return {f"{name}.{number}": image for number, image in enumerate(values.reshape(-1, *shape))}


def png(image: np.ndarray) -> bytes:
    return _png(image.tobytes(), image.shape)


@lru_cache(maxsize=16)  # those of an object, and of the empty gel, come again and again
def _png(content: bytes, shape: tuple[int, ...]) -> bytes:  # run lengths take 0.2 to 0.4 of the default's time
    file = io.BytesIO()
    Image.fromarray(np.frombuffer(content, np.uint8).reshape(shape)).save(file, "PNG", compress_type=zlib.Z_RLE)
    return file.getvalue()


def write_webdataset(folder: Path, splits: Mapping[str, GraspDataset]) -> None:
    """Write the grasps of each split: images as `.png` (several of an array are numbered), other arrays as `.npy`."""
    samples = itertools.count()
    with (folder / f"{next(iter(splits.values())).units}.csv").open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["split", "sample", "object", "class", next(iter(splits.values())).unit])
        for split, grasps in splits.items():
            shards, written = itertools.count(), SHARD_BYTES
            with ExitStack() as shard:
                for item, sample in zip(progress(grasps, desc=split, unit=grasps.unit), samples, strict=False):
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
    yield "json", json.dumps({name: item[name] for name in (*TEXT, grasps.unit)}, ensure_ascii=False).encode()
    for name in grasps.arrays:
        images = pictures(grasps, name, item[name])
        if not images:
            file = io.BytesIO()
            np.save(file, item[name])
            yield f"{name}.npy", file.getvalue()
        for key, image in images.items():
            yield f"{key}.png", png(image)


def write_parquet(folder: Path, splits: Mapping[str, GraspDataset]) -> None:
    """Write the grasps of each split as Parquet: images as files, whose paths are columns, other arrays as nested lists
    in the contract's types. Raises ImportError if pyarrow is not installed."""
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as error:
        raise ImportError(f"Parquet needs pyarrow: pip install 'pyarrow<26'; WebDataset does not ({error})") from error
    for split, grasps in splits.items():
        (folder / split).mkdir()
        path, items = folder / split / "metadata.parquet", iter(progress(grasps, desc=split, unit=grasps.unit))
        first, _ = _row(grasps[0], grasps)
        # The first bytes of all numbers together, then the second, take a third less. Single numbers stay as they are.
        floats = {key: each for key, each in first.items() if np.ndim(each) and np.asarray(each).dtype in ("f4", "f8")}
        apart = [name + ".list.element" * array.ndim for name, array in floats.items()]
        # Numbers hardly repeat: dictionaries of them take longer, and more bytes.
        how = {"compression": "zstd", "use_dictionary": False, "use_byte_stream_split": apart}
        running: list[Future[None]] = []
        with (
            parquet.ParquetWriter(path, _table(pyarrow, [first]).schema, **how) as writer,
            ThreadPoolExecutor(2) as background,  # encodes and compresses while the next rows are read
        ):
            while batch := [_row(item, grasps) for item in itertools.islice(items, ROWS)]:
                table = _table(pyarrow, [row for row, _ in batch])
                for task in running:
                    task.result()
                running = [background.submit(writer.write_table, table)]
                for _, images in batch:
                    running += [background.submit(_write_png, folder / split / name, images[name]) for name in images]
            for task in running:
                task.result()


def _columns(name: str, images: list[str]) -> list[str]:
    """The column of an array; of images, that of their files' names."""
    return [f"{name}_file_name{'s' * (images != [name])}" if images else name]


def _row(item: dict[str, Any], grasps: GraspDataset) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    row = {name: item[name] for name in (*TEXT, grasps.unit)}
    images: dict[str, np.ndarray] = {}
    for name in grasps.arrays:
        own = pictures(grasps, name, item[name])
        files = {f"{item['object']}/{item[grasps.unit]}/{key}.png": image for key, image in own.items()}
        (column,) = _columns(name, [*own])
        row[column] = [*files] if column.endswith("_file_names") else next(iter(files), item[name])
        images |= files
    return row, images


def _write_png(path: Path, image: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(png(image))


def _table(pyarrow: Any, rows: list[dict[str, Any]]) -> Any:
    columns = {}
    for name, first in rows[0].items():
        values = [row[name] for row in rows]
        if not isinstance(first, np.ndarray) or first.dtype.kind in "UO":
            columns[name] = pyarrow.array(values)
            continue
        columns[name] = pyarrow.array(np.ravel(values))
        for length in reversed(first.shape):
            columns[name] = pyarrow.FixedSizeListArray.from_arrays(columns[name], length)
    return pyarrow.table(columns)


def write_zarr_groups(folder: Path, splits: Mapping[str, GraspDataset]) -> None:
    """Write the grasps of each split. Every chunk is written: Zarr takes a missing one for zeros."""
    zarr = load_zarr()
    for split, grasps in splits.items():
        group, items = zarr.create_group(folder / f"{split}.zarr"), iter(progress(grasps, desc=split, unit=grasps.unit))
        arrays = {}
        for name, value in grasps[0].items():
            _, spec = grasps.sources.get(name, ("", None))
            arrays[name] = group.create_array(
                name,
                shape=(len(grasps), *np.shape(value)),
                dtype="string" if name in TEXT else np.asarray(value).dtype,
                chunks=(CHUNK, *np.shape(value)),
                compressors=zarr.codecs.BloscCodec(**COMPRESSION),
                attributes={"meaning": spec.meaning, "unit": spec.unit} if spec else {},
                dimension_names=(grasps.unit, *(grasps.dimensions(name) if spec else ())),
                config={"write_empty_chunks": True},
            )
        for start in range(0, len(grasps), CHUNK):
            rows = list(itertools.islice(items, CHUNK))
            for name, array in arrays.items():
                array[start : start + len(rows)] = np.array([row[name] for row in rows], array.dtype)


FORMATS = {  # by the names that the command has for them
    "webdataset": Layout(
        "webdataset", write_webdataset, "{}-*.tar", lambda name, own: [f"{key}.png" for key in own] or [f"{name}.npy"]
    ),
    "parquet": Layout("parquet", write_parquet, "{}/**", _columns),
    "zarr": Layout("zarr", write_zarr_groups, "{}.zarr/**", lambda name, _: [name]),
}
