"""A store as a folder of Zarr v3: `ZarrFiles`, with the same methods as `palpate.store.hdf5_file.Hdf5File`.

A chunk is one record, a shard one array of the batch. Zarr reads a file that is missing as the fill value, so files are
compared with the store's seal. Zarr takes 1.5 ms for a record (`python -m studies.benchmarks.reading`), so records are
read without it, at the speed of the decoder.
"""

import os
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import google_crc32c
import numcodecs.blosc
import numpy as np
import zarr
from zarr.codecs import BloscCodec, BytesCodec, Crc32cCodec, ShardingCodec
from zarr.core.metadata import ArrayV3Metadata

from palpate import seal
from palpate.seal import Seal
from palpate.store.contract import StoreError, StoreSpec

# Batches are worked on in parallel, never the chunks of one store: one thread a process, unless the user says
# otherwise (ZARR_THREADING__MAX_WORKERS). Several threads of Blosc may write a chunk's blocks in any order.
if zarr.config.get("threading.max_workers") is None:
    zarr.config.set({"threading.max_workers": 1})
numcodecs.blosc.use_threads = False

# Chosen in docs/evidence/dataset.md; lossless.
COMPRESSION: dict[str, Any] = {"cname": "zstd", "clevel": 1, "shuffle": "shuffle"}
ROOT = "zarr.json"  # the file of a group's attributes, and of an array's header
NOT_WRITTEN = 2**64 - 1  # offset of a chunk that holds the fill value (Zarr's sharding codec, version 1.0)
CHECKSUM = 4  # bytes of a CRC-32C, which ends each chunk and the index


def write_zarr(path: Path, spec: StoreSpec, arrays: Mapping[str, np.ndarray], attributes: Mapping[str, Any]) -> None:
    """Write arrays that fit the contract, strings as objects. Chunks of nothing but fill values are not written
    (Zarr's setting `array.write_empty_chunks` is False), such as those of sensors that touched nothing."""
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
            compressors=[Crc32cCodec()] if text else [BloscCodec(**COMPRESSION), Crc32cCodec()],
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
        self._arrays: dict[str, Records | zarr.Array] = {}
        self.attributes = dict(zarr.open_group(path, mode="r").attrs)

    @cached_property
    def seal(self) -> Seal:
        """The store's seal. Raises DamagedFile if the attributes are not as it states."""
        sealed = seal.read(self.path)
        sealed.require([ROOT])
        return sealed

    def array(self, name: str) -> "Records | zarr.Array":
        """One array, not read, if its files are as they were when the store was opened."""
        array = self._arrays.get(name)
        if array is None:
            array = self._arrays[name] = self._open(name)
        # At every read, because Zarr takes a missing file for one of fill values.
        self._require(shard_file(name, array), contents=False)
        return array

    def _require(self, name: str, contents: bool) -> bool:
        """Whether a file is of the store. Raises DamagedFile if it is not as it was written, or was not written."""
        if name in self.seal.files:
            self.seal.require([name], contents)
        elif os.path.exists(self.path / name):
            raise seal.damaged(self.path, f"{name} was not written with it")
        return name in self.seal.files

    def _open(self, name: str) -> "Records | zarr.Array":
        """An array whose header is the one that was written."""
        if not self._require(f"{name}/{ROOT}", contents=True):
            raise StoreError(f"{self.path} has no array {name!r}")
        array = zarr.open_array(self.path / name, mode="r")
        if not is_readable(array):
            return array
        shard = shard_file(name, array)
        return Records(self.path / shard if shard in self.seal.files else None, array)

    def names(self) -> list[str]:
        return [metadata.parent.name for metadata in self.path.glob(f"*/{ROOT}")]


def shard_file(name: str, array: Any) -> str:
    """The only file of values of a Zarr array, from its store on."""
    return f"{name}/c{'/0' * len(array.shape)}"


class Records:
    """A Zarr array, `array[index]` as numpy indexes: numbers and slices of leading axes read only their records.
    file: of its values; None if all are the fill value, and it was not written. array: as `is_readable` takes it."""

    def __init__(self, file: Path | None, array: zarr.Array):
        self.shape, self.dtype, self._fill, self._file = array.shape, array.dtype, array.fill_value, file
        self._sharded = array.shards is not None
        self._grid = [length // size for length, size in zip(array.shape, array.chunks, strict=True)]
        self._chunks = int(np.prod(self._grid))
        # Chunks are single records: along all axes but the last ones, which they cover, their length is 1.
        self._leading = next((axis for axis, size in enumerate(array.chunks) if size != 1), len(self.shape))

    def __getitem__(self, index: Any) -> np.ndarray:
        """What `index` picks. Raises IndexError as numpy does, ValueError for a wrong checksum or chunk."""
        index = index if isinstance(index, tuple) else (index,)
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
        descriptor = os.open(self._file, os.O_RDONLY)
        try:
            size = os.fstat(descriptor).st_size
            if self._sharded:
                length = 16 * self._chunks + CHECKSUM
                index = self._checked(os.pread(descriptor, length, max(size - length, 0)), "index")
                places = np.frombuffer(index, "<u8").reshape(-1, 2)[numbers.ravel()].tolist()
            else:
                places = [(0, size)] * numbers.size
            for (start, length), target in zip(places, values.reshape(numbers.size, -1), strict=True):
                if start != NOT_WRITTEN:
                    numcodecs.blosc.decompress(self._checked(os.pread(descriptor, length, start), "a chunk"), target)
        finally:
            os.close(descriptor)
        return values

    def _checked(self, data: bytes, name: str) -> bytes:
        """Bytes without the checksum at their end, which is tested."""
        content, checksum = data[:-CHECKSUM], data[-CHECKSUM:]
        if google_crc32c.value(content) != int.from_bytes(checksum, "little"):
            raise ValueError(f"{self._file}: {name} has a wrong checksum")
        return content


def is_readable(array: zarr.Array) -> bool:
    """Whether `Records` reads this array: one shard or chunk, encoded as `write_zarr` does."""
    if not isinstance(array.metadata, ArrayV3Metadata):
        return False
    codecs, whole = array.metadata.codecs, array.shards or array.chunks
    if isinstance(codecs[0], ShardingCodec):
        if [*map(type, codecs[0].index_codecs)] != [BytesCodec, Crc32cCodec]:
            return False
        codecs = codecs[0].codecs
    return whole == array.shape and [*map(type, codecs)] == [BytesCodec, BloscCodec, Crc32cCodec]
