"""A store as one HDF5 file: `Hdf5File`, with the same methods as `palpate.store.zarr_files.ZarrFiles`.

An array is one chunk with a checksum. The file's seal stands in its user block, which HDF5 skips, and is compared
before HDF5 opens the file: of some damaged files it never returns. Records are read without h5py, which takes 0.6 ms.
"""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numcodecs import Fletcher32

from palpate import seal
from palpate.store.contract import StoreError, StoreSpec


def write_hdf5(path: Path, spec: StoreSpec, arrays: Mapping[str, np.ndarray], attributes: Mapping[str, Any]) -> None:
    """Write arrays that fit the contract, strings as objects."""
    with h5py.File(path, "w", userblock_size=seal.USER_BLOCK) as file:
        # HDF5 has no nested attributes: here each is a JSON text.
        file.attrs.update({name: json.dumps(value, sort_keys=True) for name, value in attributes.items()})
        for name, array in arrays.items():
            if array.dtype == object:  # of fixed length: those of variable length have no checksums
                array = np.char.encode(array.astype(str), "utf-8")
                array = array.astype(h5py.string_dtype("utf-8", max(array.dtype.itemsize, 1)))
            whole_array = {"chunks": array.shape, "fletcher32": True} if array.size and array.ndim else {}
            dataset = file.create_dataset(name, data=array, **whole_array)
            if name in spec.arrays:
                dataset.attrs.update({"meaning": spec.arrays[name].meaning, "unit": spec.arrays[name].unit})


class Hdf5File:
    """A store's file, for reading, and its seal; some 30 kB an object."""

    def __init__(self, path: Path):
        self.path, self._stated, self.seal = path, seal.text_of(path), seal.verify(path)
        self._arrays: dict[str, Chunk] = {}
        with h5py.File(path, "r") as file:
            self.attributes = {name: json.loads(value) for name, value in file.attrs.items()}

    def array(self, name: str) -> "Chunk | np.ndarray":
        """One array, not read (a small one without chunks is). StoreError for an unknown name, or a changed file."""
        array = self._arrays.get(name)
        if array is None:
            with h5py.File(self.path, "r") as file:
                if name not in file:
                    raise StoreError(f"{self.path} has no array {name!r}")
                array = Chunk(self.path, file[name]) if file[name].chunks else file[name][...]
        if isinstance(array, Chunk):
            self._arrays[name] = array
        if seal.text_of(self.path) != self._stated:
            raise StoreError(f"{self.path} has changed since it was opened; open the dataset again")
        return array

    def names(self) -> list[str]:
        """Names of all arrays; those in groups as `hand/<name>`."""
        found: dict[str, object] = {}
        with h5py.File(self.path, "r") as file:
            file.visititems(found.__setitem__)
            return [name for name, item in found.items() if isinstance(item, h5py.Dataset)]


class Chunk:
    """An array of an HDF5 file as `write_hdf5` writes it: one chunk with a Fletcher-32. It is not kept in memory;
    `array[index]` is what numpy gives."""

    def __init__(self, path: Path, dataset: h5py.Dataset):
        place = dataset.id.get_chunk_info(0)
        self.shape, self.dtype, self._path = dataset.shape, dataset.dtype, path
        self._start, self._size = place.byte_offset, place.size

    def __getitem__(self, index: Any) -> np.ndarray:
        """What `index` picks. Raises IndexError as numpy does, RuntimeError if the checksum is wrong."""
        with self._path.open("rb", buffering=0) as file:
            data = Fletcher32().decode(os.pread(file.fileno(), self._size, self._start))
        return np.array(np.frombuffer(data, self.dtype).reshape(self.shape)[index])
