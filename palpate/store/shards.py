"""Reads rows of a sharded Zarr array, whose only shard holds one batch.

Zarr reads one record well. Of many records it decodes each chunk in a task of its own, which takes five times as long
as decoding it: here a training's data are read at the speed of the decoder.
"""

from collections.abc import Sequence
from pathlib import Path

import google_crc32c
import numpy as np
import zarr
from numcodecs import blosc
from zarr.codecs import BloscCodec, BytesCodec, Crc32cCodec, ShardingCodec

NOT_WRITTEN = 2**64 - 1  # offset of a chunk that holds the fill value (Zarr's sharding codec, version 1.0)
CHECKSUM = 4  # bytes of a CRC-32C, which ends each chunk and the index


def shard_file(folder: Path, array: zarr.Array) -> Path:
    """The only file of values of an array in `folder`."""
    return folder.joinpath("c", *["0"] * array.ndim)


def is_shard(array: zarr.Array) -> bool:
    """Whether `read_rows` reads this array: one shard, encoded as `palpate.store.write` does."""
    codec = array.metadata.codecs[0]
    if not isinstance(codec, ShardingCodec) or array.shards != array.shape:
        return False
    found = [[type(each) for each in codecs] for codecs in (codec.codecs, codec.index_codecs)]
    return found == [[BytesCodec, BloscCodec, Crc32cCodec], [BytesCodec, Crc32cCodec]]


def read_rows(folder: Path, array: zarr.Array, rows: Sequence[int]) -> np.ndarray:
    """Rows of an array along its first axis, in the order given; `array` is the one in `folder`.

    Raises ValueError if a checksum is wrong, and what the decoder raises for bytes that it can't decode.
    """
    grid = [length // size for length, size in zip(array.shape, array.chunks, strict=True)]
    per_row = int(np.prod(grid[1:]))
    values = np.full((len(rows), *array.shape[1:]), array.fill_value, array.dtype)
    shard = shard_file(folder, array)
    if not shard.exists():  # every chunk holds the fill value
        return values
    data = np.memmap(shard, dtype=np.uint8, mode="r")
    length = 16 * grid[0] * per_row + CHECKSUM
    index = _checked(data[max(len(data) - length, 0) :], f"{shard}: index").view("<u8").reshape(-1, per_row, 2)
    # Chunks are single records: along all axes but the last ones, which they cover, their length is 1.
    chunks = values.reshape(len(rows), per_row, int(np.prod(array.chunks)))
    for row, target in zip(rows, chunks, strict=True):
        for (start, size), chunk in zip(index[row].tolist(), target, strict=True):
            if start != NOT_WRITTEN:
                blosc.decompress(_checked(data[start : start + size], f"{shard}: chunk of row {row}"), chunk)
    return values


def _checked(data: np.ndarray, name: str) -> np.ndarray:
    """Bytes without the checksum at their end, which is tested."""
    content, checksum = data[:-CHECKSUM], data[-CHECKSUM:].tobytes()
    if google_crc32c.value(content.tobytes()) != int.from_bytes(checksum, "little"):
        raise ValueError(f"{name} has a wrong checksum")
    return content
