"""One batch's store on disk: written atomically and checked against the contract, read array by array.

Zarr v3 with the sharding codec or HDF5, by the suffix.
"""

import importlib.metadata
from collections.abc import Iterable, Mapping
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

import palpate
from palpate.atomic import atomic_write
from palpate.batch import Rejection, write_rejections
from palpate.configuration import ConfigError
from palpate.rebuild_command import rebuild_advice, rebuild_command
from palpate.seal import MadeFrom, Seal, with_output
from palpate.sensor import Sensor
from palpate.store.contract import CONTRACT, FRAMES, SCHEMA_VERSION, UNITS, StoreError, StoreSpec, reading
from palpate.store.hdf5_file import Hdf5File, write_hdf5
from palpate.store.zarr_files import ZarrFiles, write_zarr

STRING_KINDS = "UOST"  # numpy's kinds of types that hold text
Header = tuple[tuple[int, ...], np.dtype]  # of an array: shape and type


def write(path: Path | str, stage: str, arrays: Mapping[str, np.ndarray], attributes: Mapping[str, Any]) -> None:
    """Write one batch's store atomically; the same arrays and attributes give the same bytes.
    path: `<run>/<stage>/<batch>.zarr`, or `.h5` for grasps. stage: a key of `CONTRACT`. arrays: exactly the contract's,
    optional ones or not; a group that it allows is given as `hand/<name>`. attributes: those of the stage's
    `StoreSpec`, and what else JSON can hold; versions, units and frames are added. Among them is `made_from`
    (`palpate.seal.combine`), which goes into the store's seal. Raises StoreError if a name, shape or type is wrong."""
    path, spec = Path(path), CONTRACT[stage]
    if path.suffix != spec.stage.suffix:
        raise StoreError(f"{path}: a store of {stage} ends in {spec.stage.suffix}")
    if missing := [name for name in spec.attributes if name not in attributes]:
        raise StoreError(f"{path}: attributes {missing} are missing")
    arrays = {name: np.asarray(array) for name, array in arrays.items()}
    check_headers(path, spec, {name: (array.shape, array.dtype) for name, array in arrays.items()})
    # In one order, whatever that of the arguments, for the bytes to be the same.
    ordered = [*filter(arrays.__contains__, spec.arrays), *sorted(set(arrays) - set(spec.arrays))]
    arrays = {name: arrays[name] for name in ordered}
    for name in [name for name in ordered if arrays[name].dtype.kind in "UO"]:
        if not all(isinstance(value, str) for value in arrays[name].flat):
            raise StoreError(f"{path}: array {name!r} must hold strings only")
        arrays[name] = arrays[name].astype(object)  # which both libraries take
    library = "zarr" if path.suffix == ".zarr" else "h5py"
    versions = {name: importlib.metadata.version(name) for name in ("numpy", library, *spec.stage.engines)}
    described = {
        "schema_version": SCHEMA_VERSION,
        "stage": stage,
        "units": UNITS,
        "frames": FRAMES,
        "versions": {"palpate": palpate.__version__, **versions},
        **{name: value for name, value in attributes.items() if name != "made_from"},
    }
    with atomic_write(path, attributes["made_from"]) as partial:
        (write_zarr if path.suffix == ".zarr" else write_hdf5)(partial, spec, arrays, described)


def check_headers(path: Path, spec: StoreSpec, headers: Mapping[str, Header], optional: bool = True) -> None:
    """Raise StoreError, naming the first that is wrong, if names, shapes or types are not the contract's.
    optional: whether the arrays that the contract calls so may be missing; those that a config asks for always may."""
    given = {name for name in headers if name.split("/")[0] not in spec.stage.groups}
    needed = {name for name, array in spec.arrays.items() if not (array.optional and (optional or array.asked))}
    missing, unknown = sorted(needed - given), sorted(given - set(spec.arrays))
    if missing or unknown:
        raise StoreError(f"{path}: arrays of {spec.stage.name} missing: {missing}, unknown: {unknown}")
    sizes: dict[str, tuple[str, int]] = {}
    for name, array_spec in spec.arrays.items():
        if name not in given:
            continue
        (shape, dtype), what = headers[name], f"{path}: array {name!r}"
        right = dtype.kind in STRING_KINDS if array_spec.dtype == "string" else dtype == array_spec.dtype
        if not right:  # no silent conversion: the caller knows what the numbers mean
            raise StoreError(f"{what} must be {array_spec.dtype}, but it is {dtype}")
        lengths = [*zip(array_spec.shape, shape, strict=False)]
        if len(shape) != len(array_spec.shape) or any(isinstance(axis, int) and axis != n for axis, n in lengths):
            raise StoreError(f"{what}: shape {array_spec.axes} expected, but it is {shape}")
        for symbol, size in lengths:
            # A batch without objects has arrays of length 0, whose other axes may be unknown.
            if isinstance(symbol, str) and (shape[0] or symbol == array_spec.shape[0]):
                source, other = sizes.setdefault(symbol, (name, size))
                if size != other:
                    another = f"but {source!r} has {symbol} = {other}"
                    raise StoreError(f"{what} has shape {shape}, so {symbol} = {size}, {another}")
    if {"r", "c", "rc"} <= set(sizes):
        (_, rows), (_, columns), (name, pixels) = (sizes[symbol] for symbol in ("r", "c", "rc"))
        if pixels != rows * columns:
            raise StoreError(f"{path}: array {name!r}: {pixels} rows, but readings have {rows} x {columns} pixels")


class Store:
    """One batch's store, for reading: `store["depth"]`, `store.get("depth", 3)`, `store.attributes`. Arrays are read
    when they are asked for, and then only the records that the index needs, whose checksums are compared. Nothing stays
    open, so it is safe to fork. Raises StoreError, naming the file and the remedy, if the store is missing, unreadable,
    or of another schema version, or lacks a file that was written or has one of another size."""

    def __init__(self, path: Path | str):
        self.path = Path(path)
        if not self.path.exists():
            raise StoreError(f"{self.path} does not exist; build it with: {rebuild_command(self.path)}")
        with reading(self.path):
            self._files = ZarrFiles(self.path) if self.path.suffix == ".zarr" else Hdf5File(self.path)
        version = self._files.attributes.get("schema_version")
        if version != SCHEMA_VERSION:  # of all stores of the run
            again = rebuild_command(self.path, "dataset", "/".join(self.path.parts[-2:]))
            raise StoreError(
                f"{self.path} has schema version {version}, but this palpate reads version {SCHEMA_VERSION}; "
                f"use the palpate that made it, or build the run again with: {again} --forceall"
            )
        if self.path.suffix == ".zarr":  # opening compares an HDF5 file whole
            with reading(self.path):
                self.seal.require(contents=False)
        self.attributes = {**self._files.attributes, "made_from": self.seal.made_from}

    @property
    def seal(self) -> Seal:
        return self._files.seal

    @cached_property
    def empty_reading(self) -> np.ndarray:
        """(r, c, 3) uint8 reading of a sensor that touches nothing, of stores that have one."""
        return self.get("empty_reading")

    @cached_property
    def sensor(self) -> Sensor:
        """The touch sensor that it states. Raises StoreError, naming the file, if it states none."""
        try:
            return Sensor.from_description(self.attributes["sensor"], self.empty_reading)
        except (KeyError, ConfigError) as error:
            raise StoreError(f"{self.path} does not state its sensor ({error}); {rebuild_advice(self.path)}") from None

    @cached_property
    def rows(self) -> dict[str, int]:
        return {str(name): row for row, name in enumerate(self.get("object"))}

    def names(self) -> list[str]:
        """Names of all arrays, sorted; those in groups as `hand/<name>`."""
        with reading(self.path):
            return sorted(self._files.names())

    def header(self, name: str) -> Header:
        """Shape and type of an array, which is not read."""
        with reading(self.path):
            array = self._files.array(name)
            return tuple(array.shape), array.dtype

    def get(self, name: str, index: Any = ...) -> np.ndarray:
        """What `index` picks of one array as numpy does, read now; strings come as a numpy array of str. If it has
        numbers and slices only, only their records are read."""
        with reading(self.path):
            values = np.asarray(self._files.array(name)[index])
            if values.dtype.kind == "S":
                return np.char.decode(values, "utf-8")
            return values.astype(str) if values.dtype == object else values

    __getitem__ = get

    def __contains__(self, name: str) -> bool:
        return name in self.names()

    def __repr__(self) -> str:
        return f"Store({str(self.path)!r}: {', '.join(self.names())})"


open = Store  # `palpate.store.open(path)`


def read(path: Path | str, *names: str) -> dict[str, np.ndarray]:
    """The named arrays of one batch's store, or all of them (`hand/<name>` for those in groups)."""
    store = Store(path)
    return {name: store.get(name) for name in names or store.names()}


def join(stage: str, records: Mapping[str, Mapping[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """The arrays of a batch, stacked from those of its objects, in the contract's types, with `object`. Optional ones
    that no object has are omitted. Axes of a batch without objects have length 0; it has no arrays that only a config
    asks for. Raises StoreError if objects have arrays of different shapes."""
    arrays = {"object": np.array(list(records), dtype=str)}
    for name, spec in CONTRACT[stage].arrays.items():
        if not spec.of_objects or name == "object":
            continue
        if (spec.asked or spec.optional and records) and not any(name in record for record in records.values()):
            continue
        rows = {key: np.asarray(record[name], dtype=spec.dtype) for key, record in records.items()}
        shapes = {row.shape: key for key, row in rows.items()}
        if len(shapes) > 1:
            found = ", ".join(f"{shape} of {key}" for shape, key in shapes.items())
            raise StoreError(f"{stage} {name!r} has different shapes: {found}")
        empty = [size if isinstance(size, int) else 0 for size in spec.shape]
        arrays[name] = np.stack(list(rows.values())) if rows else np.empty(empty, spec.dtype)
    return arrays


def write_batch(
    paths: Mapping[str, Path | str],
    stage: str,
    results: tuple[Mapping[str, Mapping[str, np.ndarray]], Iterable[Rejection]],
    seed: int,
    made_from: MadeFrom,
    more: Mapping[str, np.ndarray] = MappingProxyType({}),
    attributes: Mapping[str, Any] = MappingProxyType({}),
) -> None:
    """Write a stage's results for a batch: the table of rejections, then the store, both atomically.
    paths: of the store by the stage's name, as for `write`, and of the table (.csv) by `rejected`; results: as
    `palpate.batch.each_object` returns them, the objects' arrays as for `join`; made_from: see `palpate.seal.combine`;
    more: arrays of the batch; attributes: further ones that the stage's stores have. Raises StoreError as `write`."""
    records, rejections = results
    write_rejections(paths["rejected"], rejections, made_from)
    arrays = {**join(stage, records), **more}
    stated = {"seed": seed, "made_from": with_output(made_from, paths["rejected"]), **attributes}
    write(paths[stage], stage, arrays, stated)
