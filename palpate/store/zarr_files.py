"""A store as a folder of Zarr v3: `ZarrFiles`, with the same methods as `palpate.store.hdf5_file.Hdf5File`.

A chunk is one record, a shard one array of the batch. Zarr reads a file that is missing as the fill value, so files are
compared with the store's seal. Zarr takes 1.5 ms for a record (`python -m studies.benchmarks.reading`) and 0.2 s to be
imported, so what `write_zarr` wrote is read without it, at the speed of the decoder.
"""

import json
import os
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import Any

import google_crc32c
import numcodecs.blosc
import numpy as np

from palpate import seal
from palpate.seal import Seal
from palpate.store.contract import StoreError, StoreSpec

numcodecs.blosc.use_threads = False  # several threads may write a chunk's blocks in any order

# Chosen in docs/evidence/dataset.md; lossless.
COMPRESSION: dict[str, Any] = {"cname": "zstd", "clevel": 1, "shuffle": "shuffle"}
SHARDING = "sharding_indexed"  # Zarr's name of its codec
ROOT = "zarr.json"  # the file of a group's attributes, and of an array's header
NOT_WRITTEN = 2**64 - 1  # offset of a chunk that holds the fill value (Zarr's sharding codec, version 1.0)
CHECKSUM = 4  # bytes of a CRC-32C, which ends each chunk and the index


def load_zarr() -> ModuleType:
    """Import `zarr` and return it. Batches are worked on in parallel, never the chunks of one store: it has one thread
    a process, unless the user says otherwise (ZARR_THREADING__MAX_WORKERS)."""
    import zarr

    if zarr.config.get("threading.max_workers") is None:
        zarr.config.set({"threading.max_workers": 1})
    return zarr


def write_zarr(path: Path, spec: StoreSpec, arrays: Mapping[str, np.ndarray], attributes: Mapping[str, Any]) -> None:
    """Write arrays that fit the contract, strings as objects. Chunks of nothing but fill values are not written
    (Zarr's setting `array.write_empty_chunks` is False), such as those of sensors that touched nothing."""
    zarr = load_zarr()
    crc, blosc = zarr.codecs.Crc32cCodec(), zarr.codecs.BloscCodec(**COMPRESSION)
    group = zarr.create_group(path, attributes=dict(attributes))
    for name, array in arrays.items():
        array_spec = spec.arrays[name]
        text = array_spec.dtype == "string"
        chunk = array_spec.chunk(array.shape)
        shard = tuple(max(length, 1) for length in array.shape)
        target = group.create_array(
            name,
            shape=array.shape,
            dtype="string" if text else array.dtype,
            chunks=chunk,
            shards=shard if shard != chunk else None,
            compressors=[crc] if text else [blosc, crc],
            fill_value=array_spec.fill if text else array.dtype.type(array_spec.fill),
            attributes={"meaning": array_spec.meaning, "unit": array_spec.unit},
            dimension_names=array_spec.dimensions,  # which xarray opens it by
        )
        if array.size:
            target[...] = array


class ZarrFiles:
    """A store's folder, for reading, and its seal."""

    def __init__(self, path: Path):
        self.path = path
        self._arrays: dict[str, tuple[str, Records]] = {}  # the file of an array's values, and the array
        self.attributes = json.loads((path / ROOT).read_bytes())["attributes"]

    @cached_property
    def seal(self) -> Seal:
        """The store's seal. Raises DamagedFile if the attributes are not as it states."""
        sealed = seal.read(self.path)
        sealed.require([ROOT])
        return sealed

    def array(self, name: str) -> "Records":
        """One array, not read, if its files are as they were when the store was opened."""
        if name not in self._arrays:
            if not self._require(f"{name}/{ROOT}", contents=True):
                raise StoreError(f"{self.path} has no array {name!r}")
            header = json.loads((self.path / name / ROOT).read_bytes())
            file = f"{name}/c{'/0' * len(header['shape'])}"  # the only one of its values
            self._arrays[name] = file, Records(self.path / file if file in self.seal.files else None, header)
        file, records = self._arrays[name]
        self._require(file, contents=False)  # at every read, because a missing file is one of fill values
        return records

    def _require(self, name: str, contents: bool) -> bool:
        """Whether a file is of the store. Raises DamagedFile if it is not as it was written, or was not written."""
        if name in self.seal.files:
            self.seal.require([name], contents)
        elif os.path.exists(self.path / name):
            raise seal.damaged(self.path, f"{name} was not written with it")
        return name in self.seal.files

    def names(self) -> list[str]:
        return [metadata.parent.name for metadata in self.path.glob(f"*/{ROOT}")]


class Records:
    """A Zarr array of `write_zarr`, `array[index]` as numpy indexes: numbers and slices of leading axes read only their
    records. file: of its values; None if all are the fill value, and it was not written. header: what zarr.json has."""

    def __init__(self, file: Path | None, header: Mapping[str, Any]):
        self._file, self._text = file, header["data_type"] == "string"
        self.shape, self.dtype = tuple(header["shape"]), np.dtype(object if self._text else header["data_type"])
        self._fill = header["fill_value"] if self._text else self.dtype.type(header["fill_value"])  # "Infinity", too
        self._sharded = header["codecs"][0]["name"] == SHARDING
        chunks = (header["codecs"][0] if self._sharded else header["chunk_grid"])["configuration"]["chunk_shape"]
        self._grid = [length // size for length, size in zip(self.shape, chunks, strict=True)]
        self._chunks = int(np.prod(self._grid))
        # Chunks are single records: along all axes but the last ones, which they cover, their length is 1.
        self._leading = next((axis for axis, size in enumerate(chunks) if size != 1), len(self.shape))

    def __getitem__(self, index: Any) -> np.ndarray:
        """What `index` picks. Raises IndexError as numpy does, ValueError for a wrong checksum or chunk."""
        index = index if isinstance(index, tuple) else (index,)
        if 0 in self.shape:
            return np.empty(self.shape, self.dtype)[index]
        numbers = np.arange(self._chunks).reshape(self._grid[: self._leading])
        if not all(isinstance(each, int | np.integer | slice) for each in index):
            return self._read(numbers)[index]
        numbers = np.asarray(numbers[index[: self._leading]])
        return self._read(numbers)[(slice(None),) * numbers.ndim + index[self._leading :]]

    def _read(self, numbers: np.ndarray) -> np.ndarray:
        """The chunks of these numbers, in their shape."""
        values = np.full((*numbers.shape, *self.shape[self._leading :]), self._fill, self.dtype)
        if self._file is None or not values.size:
            return values
        with open(self._file, "rb", buffering=0) as file:
            size = os.fstat(file.fileno()).st_size
            if self._sharded:
                length = 16 * self._chunks + CHECKSUM
                index = self._checked(os.pread(file.fileno(), length, max(size - length, 0)), "index")
                places = np.frombuffer(index, "<u8").reshape(-1, 2)[numbers.ravel()].tolist()
            else:
                places = [(0, size)] * numbers.size
            for (start, length), target in zip(places, values.reshape(numbers.size, -1), strict=True):
                if start != NOT_WRITTEN:
                    chunk = self._checked(os.pread(file.fileno(), length, start), "a chunk")
                    (numcodecs.VLenUTF8().decode if self._text else numcodecs.blosc.decompress)(chunk, target)
        return values

    def _checked(self, data: bytes, name: str) -> bytes:
        """Bytes without the checksum at their end, which is tested."""
        content, checksum = data[:-CHECKSUM], data[-CHECKSUM:]
        if google_crc32c.value(content) != int.from_bytes(checksum, "little"):
            raise ValueError(f"{self._file}: {name} has a wrong checksum")
        return content
