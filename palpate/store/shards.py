"""Reads records of a store's arrays at the speed of the decoder, without Zarr's and HDF5's own reading.

Zarr takes 1.5 ms for a record, h5py 0.6 ms, and a grasp has 25 arrays (`python -m studies.benchmarks.reading`). Nothing
stays open, and nothing is kept but where an array's values are.
"""

import os
from pathlib import Path
from typing import Any

import google_crc32c
import h5py
import numpy as np
import zarr
from numcodecs import Fletcher32, blosc
from zarr.codecs import BloscCodec, BytesCodec, Crc32cCodec, ShardingCodec

NOT_WRITTEN = 2**64 - 1  # offset of a chunk that holds the fill value (Zarr's sharding codec, version 1.0)
CHECKSUM = 4  # bytes of a CRC-32C, which ends each chunk and the index


def shard_file(name: str, array: Any) -> str:
    """The only file of values of a Zarr array, from its store on."""
    return f"{name}/c{'/0' * len(array.shape)}"


class Records:
    """A Zarr array, `array[index]` as numpy indexes: numbers and slices of leading axes read only their records.

    file: of its values; None if all are the fill value, and it was not written. array: as `is_readable` takes it.
    """

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
        simple = index[1:] if index and isinstance(index[0], np.ndarray) and index[0].ndim == 1 else index
        if not all(isinstance(each, int | np.integer | slice) for each in simple):
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
                    blosc.decompress(self._checked(os.pread(descriptor, length, start), "a chunk"), target)
        finally:
            os.close(descriptor)
        return values

    def _checked(self, data: bytes, name: str) -> bytes:
        """Bytes without the checksum at their end, which is tested."""
        content, checksum = data[:-CHECKSUM], data[-CHECKSUM:]
        if google_crc32c.value(content) != int.from_bytes(checksum, "little"):
            raise ValueError(f"{self._file}: {name} has a wrong checksum")
        return content


class Chunk:
    """An array of an HDF5 file, as `is_chunk` takes it, that is not kept; `array[index]` is what numpy gives."""

    def __init__(self, path: Path, dataset: h5py.Dataset):
        place = dataset.id.get_chunk_info(0)
        self.shape, self.dtype, self._path = dataset.shape, dataset.dtype, path
        self._start, self._size = place.byte_offset, place.size

    def __getitem__(self, index: Any) -> np.ndarray:
        """What `index` picks. Raises IndexError as numpy does, RuntimeError if the checksum is wrong."""
        with self._path.open("rb", buffering=0) as file:
            data = Fletcher32().decode(os.pread(file.fileno(), self._size, self._start))
        return np.array(np.frombuffer(data, self.dtype).reshape(self.shape)[index])


def is_chunk(dataset: h5py.Dataset) -> bool:
    """Whether `Chunk` reads this array: one chunk with a Fletcher-32, as `palpate.store.write` does."""
    filters = dataset.id.get_create_plist().get_nfilters()
    return dataset.chunks == dataset.shape and dataset.fletcher32 and filters == 1 and not dataset.dtype.hasobject


def is_readable(array: zarr.Array) -> bool:
    """Whether `Records` reads this array: one shard or chunk, encoded as `palpate.store.write` does."""
    codecs, whole = array.metadata.codecs, array.shards or array.chunks
    if isinstance(codecs[0], ShardingCodec):
        if [*map(type, codecs[0].index_codecs)] != [BytesCodec, Crc32cCodec]:
            return False
        codecs = codecs[0].codecs
    return whole == array.shape and [*map(type, codecs)] == [BytesCodec, BloscCodec, Crc32cCodec]
