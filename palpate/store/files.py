"""One batch's store on disk: written atomically and checked against the contract, read array by array.

Zarr v3 with the sharding codec (a chunk is one record, a shard one array of the batch) or HDF5, by the suffix.
"""

import hashlib
import importlib.metadata
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numcodecs.blosc
import numpy as np
import zarr
from zarr.codecs import BloscCodec, Crc32cCodec

import palpate
from palpate import checksums
from palpate.atomic import atomic_write
from palpate.provenance import Made
from palpate.rebuild_command import rebuild_advice, rebuild_command
from palpate.store.contract import CONTRACT, FRAMES, SCHEMA_VERSION, UNITS, ArraySpec, StoreSpec
from palpate.store.shards import Chunk, Records, is_chunk, is_readable, shard_file

# Batches are worked on in parallel, never the chunks of one store: one thread a process, unless the user says
# otherwise (ZARR_THREADING__MAX_WORKERS). Several threads of Blosc may write a chunk's blocks in any order.
if zarr.config.get("threading.max_workers") is None:
    zarr.config.set({"threading.max_workers": 1})
numcodecs.blosc.use_threads = False

# Chosen in studies/benchmarks/store.py; lossless.
COMPRESSION = {"cname": "zstd", "clevel": 1, "shuffle": "shuffle"}
STRING_KINDS = "UOST"  # numpy's kinds of types that hold text
# A Zarr store's attribute: `files`, the manifest of all files but the one that holds it, and `sha256`, the checksum of
# the other attributes and the manifest.
MANIFEST = "manifest"
ROOT = "zarr.json"  # the file of a Zarr group's attributes, and of an array's header
# Bytes before the content of an HDF5 file (its user block, which HDF5 skips): the content's size and SHA-256 as JSON.
USER_BLOCK = 512


class StoreError(ValueError):
    """A store, or arrays to be written, violate the contract; the message names the file."""


def write(path: Path | str, stage: str, arrays: Mapping[str, np.ndarray], attributes: Mapping[str, Any]) -> None:
    """Write one batch's store atomically.

    Chunks that hold nothing but the array's fill value, such as those of sensors that touched nothing, are not
    written (Zarr's setting `array.write_empty_chunks` is False): they read as the fill value.

    path: `<run>/<stage>/<batch>.zarr`, or `.h5` for grasps. stage: a key of `CONTRACT`.
    arrays: exactly the contract's arrays, optional ones or not; a group that it allows is given as
    `hand/<name>`.
    attributes: those of the stage's `StoreSpec`, and what else JSON can hold; versions, units and frames are added.
    The same arrays and attributes give the same bytes. Raises StoreError if a name, shape or type is wrong.
    """
    path = Path(path)
    spec = CONTRACT[stage]
    if path.suffix != spec.stage.suffix:
        raise StoreError(f"{path}: a store of {stage} ends in {spec.stage.suffix}")
    missing = [name for name in spec.attributes if name not in attributes]
    if missing:
        raise StoreError(f"{path}: attributes {missing} are missing")
    arrays = {name: np.asarray(array) for name, array in arrays.items()}
    check_headers(path, spec, {name: (array.shape, array.dtype) for name, array in arrays.items()})
    # In one order, whatever that of the arguments, for the bytes to be the same.
    arrays = {
        name: _text(path, name, arrays[name]) if arrays[name].dtype.kind in "UO" else arrays[name]
        for name in [*filter(arrays.__contains__, spec.arrays), *sorted(set(arrays) - set(spec.arrays))]
    }
    described = {**describe(spec), **attributes}
    with atomic_write(path) as partial:
        if path.suffix == ".zarr":
            _write_zarr(partial, spec, arrays, described)
        else:
            _write_hdf5(partial, spec, arrays, described)


def describe(spec: StoreSpec) -> dict[str, Any]:
    """Attributes that every store of this stage carries: schema version, units, frames, what made it."""
    library = "zarr" if spec.stage.suffix == ".zarr" else "h5py"
    versions = {name: importlib.metadata.version(name) for name in ("numpy", library, *spec.stage.engines)}
    return {
        "schema_version": SCHEMA_VERSION,
        "stage": spec.stage.name,
        "units": UNITS,
        "frames": FRAMES,
        "versions": {"palpate": palpate.__version__, **versions},
    }


Header = tuple[tuple[int, ...], np.dtype]  # of an array: shape and type


def check_headers(path: Path, spec: StoreSpec, headers: Mapping[str, Header], optional: bool = True) -> None:
    """Raise StoreError, naming the first that is wrong, if names, shapes or types are not the contract's.

    optional: whether the arrays that the contract calls so may be missing.
    """
    given = {name for name in headers if name.split("/")[0] not in spec.stage.groups}
    needed = {name for name, array in spec.arrays.items() if not (optional and array.optional)}
    missing, unknown = sorted(needed - given), sorted(given - set(spec.arrays))
    if missing or unknown:
        raise StoreError(f"{path}: arrays of {spec.stage.name} missing: {missing}, unknown: {unknown}")
    sizes: dict[str, tuple[str, int]] = {}
    for name, array_spec in spec.arrays.items():
        if name not in given:
            continue
        shape, dtype = headers[name]
        right = dtype.kind in STRING_KINDS if array_spec.dtype == "string" else dtype == array_spec.dtype
        if not right:  # no silent conversion: the caller knows what the numbers mean
            raise StoreError(f"{path}: array {name!r} must be {array_spec.dtype}, but it is {dtype}")
        check_shape(path, array_spec, shape, sizes)


def check_shape(path: Path, spec: ArraySpec, shape: tuple[int, ...], sizes: dict[str, tuple[str, int]]) -> None:
    """Check one shape against the contract and against the arrays before it, whose symbols are in `sizes`."""
    try:
        found = spec.sizes(shape)
    except ValueError as error:
        raise StoreError(f"{path}: array {spec.name!r}: {error}") from None
    if shape[0] == 0:  # of a batch without objects, whose other axes may be unknown
        found = {symbol: length for symbol, length in found.items() if symbol == spec.shape[0]}
    for symbol, length in found.items():
        source, expected = sizes.setdefault(symbol, (spec.name, length))
        if length != expected:
            raise StoreError(
                f"{path}: array {spec.name!r} has shape {shape}, so {symbol} = {length}, "
                f"but {source!r} has {symbol} = {expected}"
            )
    values = {symbol: length for symbol, (_, length) in sizes.items()}
    if "rc" in found and "c" in values and values["rc"] != values["r"] * values["c"]:
        raise StoreError(
            f"{path}: array {spec.name!r}: {values['rc']} rows, but readings have {values['r']} x {values['c']} pixels"
        )


def _text(path: Path, name: str, array: np.ndarray) -> np.ndarray:
    """An array of strings as an array of objects, which both libraries take."""
    if not all(isinstance(value, str) for value in array.flat):
        raise StoreError(f"{path}: array {name!r} must hold strings only")
    return array.astype(object)


def _write_zarr(path: Path, spec: StoreSpec, arrays: dict[str, np.ndarray], attributes: dict[str, Any]) -> None:
    group = zarr.create_group(path)
    for name in filter(arrays.__contains__, spec.arrays):
        array, array_spec = arrays[name], spec.arrays[name]
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
        )
        if array.size:
            target[...] = array
    seal(path, attributes)


def seal(path: Path, attributes: Mapping[str, Any] | None = None) -> None:
    """Have a store that is written state what it holds: its files' sizes and checksums.

    attributes: those to give to a Zarr store; by default those that it has.
    """
    if path.suffix != ".zarr":
        stated = _user_block(path.read_bytes()[USER_BLOCK:])
        with path.open("r+b") as file:
            file.write(stated)
        return
    group = zarr.open_group(path, mode="r+")
    attributes = dict(group.attrs if attributes is None else attributes)
    attributes.pop(MANIFEST, None)
    # Zarr reads a file that is missing as the fill value.
    files = {name: stated for name, stated in checksums.manifest_of(path).items() if name != ROOT}
    group.attrs.put({**attributes, MANIFEST: {"sha256": _digest(attributes, files), "files": files}})


def _user_block(content: bytes) -> bytes:
    stated = {"size": len(content), "sha256": hashlib.sha256(content).hexdigest()}
    return json.dumps(stated).encode().ljust(USER_BLOCK)


def _digest(attributes: Mapping[str, Any], files: checksums.Manifest) -> str:
    return hashlib.sha256(json.dumps([attributes, files], sort_keys=True).encode()).hexdigest()


def _write_hdf5(path: Path, spec: StoreSpec, arrays: dict[str, np.ndarray], attributes: dict[str, Any]) -> None:
    with h5py.File(path, "w", userblock_size=USER_BLOCK) as file:
        file.attrs.update({name: json.dumps(value, sort_keys=True) for name, value in attributes.items()})
        for name, array in arrays.items():
            if array.dtype == object:  # of fixed length: those of variable length have no checksums
                array = np.char.encode(array.astype(str), "utf-8")
                array = array.astype(h5py.string_dtype("utf-8", max(array.dtype.itemsize, 1)))
            whole_array = {"chunks": array.shape, "fletcher32": True} if array.size and array.ndim else {}
            dataset = file.create_dataset(name, data=array, **whole_array)
            if name in spec.arrays:
                dataset.attrs.update({"meaning": spec.arrays[name].meaning, "unit": spec.arrays[name].unit})
    seal(path)


def _as_str(values: np.ndarray) -> np.ndarray:
    """An array as read, its strings as numpy's str."""
    if values.dtype.kind == "S":
        return np.char.decode(values, "utf-8")
    return values.astype(str) if values.dtype == object else values


class Store:
    """One batch's store, for reading: `store["depth"]`, `store.get("depth", 3)`, `store.attributes`.

    Arrays are read when they are asked for, and then only the records that the index needs. Nothing stays
    open, so it is safe to fork. Raises StoreError, naming the file and the remedy, if the store is missing,
    unreadable, or of another schema version, or lacks a file that was written or has one of another size. Every value
    that is read is compared with its checksum.
    """

    def __init__(self, path: Path | str):
        self.path = Path(path)
        if not self.path.exists():
            raise StoreError(f"{self.path} does not exist; build it with: {rebuild_command(self.path)}")
        self._headers: dict[str, Records | Chunk | zarr.Array] = {}
        if self.path.suffix != ".zarr":
            self._require_intact_hdf5()
        with self._reading():
            if self.path.suffix == ".zarr":
                attributes = dict(zarr.open_group(self.path, mode="r").attrs)
            else:  # HDF5 has no nested attributes: there each is a JSON text
                with h5py.File(self.path, "r") as file:
                    attributes = {name: json.loads(value) for name, value in file.attrs.items()}
        version = attributes.get("schema_version")
        if version != SCHEMA_VERSION:
            raise StoreError(
                f"{self.path} has schema version {version}, but this palpate reads version {SCHEMA_VERSION}; "
                f"use the palpate that made it, or build the run again with: {self._rebuild}"
            )
        stated = attributes.pop(MANIFEST, {})
        self.attributes, self._files = attributes, stated.get("files", {})
        if self.path.suffix == ".zarr" and stated.get("sha256") != _digest(self.attributes, self._files):
            raise self._damaged([f"{ROOT} has changed since it was written (checksum)"])
        if self.path.suffix == ".zarr":
            self._require_intact(contents=False)

    def _require_intact_hdf5(self) -> None:
        """Raise StoreError if an HDF5 file, some 30 kB an object, is not as it was written.

        Before HDF5 opens it: of some damaged files it never returns. Files of earlier versions have no user block.
        """
        with self._reading():
            data = self.path.read_bytes()
            self._content = hashlib.sha256(data[:USER_BLOCK]).hexdigest()
        earlier = data.startswith(b"\x89HDF\r\n\x1a\n")
        if not earlier and data[:USER_BLOCK] != _user_block(data[USER_BLOCK:]):
            raise self._damaged(["it has changed since it was written (checksum)"])
        self._block = data[:USER_BLOCK]

    def _require_intact(self, contents: bool) -> None:
        """Raise StoreError, naming the first files, if files are missing or of another size (or content)."""
        if self.path.suffix != ".zarr":
            self._require_intact_hdf5()
        elif found := checksums.find_damage(self.path, self._files, contents):
            raise self._damaged(found)

    def _damaged(self, lines: list[str]) -> StoreError:
        return StoreError(f"{self.path} is damaged: {checksums.join_first(lines)}; {rebuild_advice(self.path)}")

    def verify(self) -> None:
        """Compare all files with their checksums. Raises StoreError, naming the first, if any is not as written."""
        self._require_intact(contents=True)

    @property
    def digest(self) -> str:
        """SHA-256 of what the store states of its files: other content has another digest."""
        return _digest(self.attributes, self._files) if self._files else self._content

    @property
    def made(self) -> Made:
        """What it holds and what it was made from, to compare with other stores."""
        return Made(self.path, self.attributes["stage"], self.digest, self.attributes["made_from"])

    @property
    def _target(self) -> str:
        """The path as Snakemake's targets name it: from the run's folder on."""
        return "/".join(self.path.parts[-2:])

    @property
    def _rebuild(self) -> str:
        """The command that builds all stores of the run again: they have one schema version."""
        return f"{rebuild_command(self.path, 'dataset', self._target)} --forceall"

    @contextmanager
    def _reading(self) -> Iterator[None]:
        try:
            yield
        except (StoreError, IndexError, PermissionError):  # not about what the file holds
            raise
        except Exception as error:
            raise StoreError(
                f"{self.path} can't be read ({type(error).__name__}: {error}); {rebuild_advice(self.path)}"
            ) from error

    def _array(self, name: str) -> Records | Chunk | zarr.Array | np.ndarray:
        """One array, not read, of a file that is as it was when the store was opened; StoreError if it is missing."""
        array = self._headers.get(name)
        if array is None:
            array = self._opened(name)
        if self.path.suffix != ".zarr":
            with self.path.open("rb", buffering=0) as file:
                if file.read(USER_BLOCK) != self._block:
                    raise StoreError(f"{self.path} has changed since it was opened; open the dataset again")
            return array
        # At every read, because Zarr takes a missing file for one of fill values.
        shard = shard_file(name, array)
        stated = {shard: self._files[shard]} if shard in self._files else {}
        found = checksums.find_damage(self.path, stated)
        if not stated and os.path.exists(self.path / shard):
            found = [f"{shard} was not written with it"]
        if found:
            raise self._damaged(found)
        return array

    def _opened(self, name: str) -> Records | Chunk | zarr.Array | np.ndarray:
        """An array whose header is the one that was written, remembered; a small one of HDF5 without chunks is read."""
        if self.path.suffix != ".zarr":
            with h5py.File(self.path, "r") as file:
                if name not in file:
                    raise StoreError(f"{self.path} has no array {name!r}")
                if not is_chunk(file[name]):
                    return file[name][...]
                return self._headers.setdefault(name, Chunk(self.path, file[name]))
        header = f"{name}/{ROOT}"
        if header not in self._files:
            if (self.path / header).exists():
                raise self._damaged([f"{header} was not written with it"])
            raise StoreError(f"{self.path} has no array {name!r}")
        if found := checksums.find_damage(self.path, {header: self._files[header]}, contents=True):
            raise self._damaged(found)
        array = zarr.open_array(self.path / name, mode="r")
        if is_readable(array):
            shard = shard_file(name, array)
            array = Records(self.path / shard if shard in self._files else None, array)
        return self._headers.setdefault(name, array)

    def names(self) -> list[str]:
        """Names of all arrays, sorted; those in groups as `hand/<name>`."""
        if self.path.suffix == ".zarr":
            return sorted(metadata.parent.name for metadata in self.path.glob("*/zarr.json"))
        found: dict[str, object] = {}
        with self._reading(), h5py.File(self.path, "r") as file:
            file.visititems(found.__setitem__)
            return sorted(name for name, item in found.items() if isinstance(item, h5py.Dataset))

    def header(self, name: str) -> Header:
        """Shape and type of an array, which is not read."""
        with self._reading():
            array = self._array(name)
            return tuple(array.shape), array.dtype

    def get(self, name: str, index: Any = ...) -> np.ndarray:
        """What `index` picks of one array as numpy does, read now; strings come as a numpy array of str.

        Only the records are read that numbers, slices, and numbers of rows in a numpy array pick.
        """
        with self._reading():
            array = self._array(name)
            return _as_str(np.asarray((array[...] if isinstance(array, zarr.Array) else array)[index]))

    __getitem__ = get

    def __contains__(self, name: str) -> bool:
        return name in self.names()

    def __repr__(self) -> str:
        return f"Store({str(self.path)!r}: {', '.join(self.names())})"


def open(path: Path | str) -> Store:
    """Open one batch's store for reading."""
    return Store(path)


def read(path: Path | str, *names: str) -> dict[str, np.ndarray]:
    """The named arrays of one batch's store, or all of them (`hand/<name>` for those in groups)."""
    store = Store(path)
    return {name: store.get(name) for name in names or store.names()}
