"""Packs: what a family of experiments is trained and measured on, in one file, and in memory as tensors.

A family's pack (see `families`) holds the objects that all its stores have, and only the arrays that it sees.

| array | shape | type | in families |
|---|---|---|---|
| `object`, `class`, `split` | (o,) | string | all |
| `points` | (o, n, 3) m | float32 | all |
| `unoccluded` | (o, p, p, 3) | uint8 | unoccluded |
| `occluded` | (o, g, p, p, 3) | uint8 | occluded |
| `views`, `camera` | (o, v, q, q, 3), (o, v, 3, 4) to pixels | uint8, float32 | views |
| `success` | (o, g, 4) | bool | charts, readings |
| `position`, `rotation` | (o, g, 4, 3) m, (o, g, 4, 3, 3) | float32 | charts, readings |
| `charts` | (o, g, 4, 81, 3) m | float32 | charts |
| `reading` (that of an untouched sensor is `empty_reading`) | (o, g, 4, 100, 100, 3) | uint8 | readings |
| `empty_reading` | (100, 100, 3) | uint8 | readings |

Positions are in the world frame.
"""

import csv
import hashlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import h5py
import numpy as np

from palpate import store
from palpate.atomic import atomic_write
from palpate.catalogue import SPLITS
from palpate.scene import Plan
from palpate.training.families import Source, sources

SCHEMA_VERSION = 1
# Greatest coordinate of the world, metres: what is farther is in another unit, or broken.
FAR = 10.0
IN_MEMORY = "the pack"  # in messages
LIMITS = {"points": FAR, "position": FAR, "charts": FAR, "rotation": 1.001}


class PackError(ValueError):
    """A pack can't be made or read; the message names the file and what to do."""


def write(
    path: Path | str,
    family: str,
    catalogue: Path | str,
    stores: Mapping[str, Sequence[Path | str]],
    plan: Plan | None = None,
) -> None:
    """Make a pack, whole or not at all.

    path: `<run>/packs/<family>.h5`. catalogue: the run's `catalogue.csv`. stores: of each of `stages(family)`
    the stores of all batches, in one order. Objects are those that all of a batch's stores have. plan: what
    the pack holds, of a `pack` or an `experiment`; the family's own if None. Every row has a checksum, which
    reading looks at.

    Raises PackError if no object is left, a store has another shape than the others, or a value that must be
    finite is not, naming the object.
    """
    arrays = sources(family, plan)
    with open(catalogue, newline="", encoding="utf-8") as file:
        rows = {row["object"]: row for row in csv.DictReader(file)}
    batches = [
        {stage: store.open(found) for stage, found in zip(stores, paths, strict=True)}
        for paths in zip(*stores.values(), strict=True)
    ]
    chosen = [_common(batch, rows) for batch in batches]
    names = [name for batch in chosen for name in batch]
    if not names:
        raise PackError(f"{path}: no object is in all of {', '.join(stores)}; rejected.csv says why")
    digest = hashlib.sha256()
    with atomic_write(path) as partial, h5py.File(partial, "w") as file:
        for column in ("object", "class", "split"):
            text = [rows[name][column] for name in names]
            values = np.array(text, dtype=h5py.string_dtype("utf-8", max(map(len, text))))
            file.create_dataset(column, data=values, fletcher32=True)
            digest.update("\0".join(text).encode())
        for name, source in arrays.items():
            start = 0
            for batch, objects in zip(batches, chosen, strict=True):
                values = _rows(batch[source.stage], source, objects)
                if not len(values):
                    continue
                _check_finite(path, source, objects, values)
                if name not in file:
                    shape = values.shape[1:]
                    file.create_dataset(name, (len(names), *shape), source.dtype, chunks=(1, *shape), fletcher32=True)
                if values.shape[1:] != file[name].shape[1:]:
                    raise PackError(
                        f"{batch[source.stage].path}: {source.name} of an object is {values.shape[1:]}, "
                        f"of others {file[name].shape[1:]}; build both again from one config"
                    )
                file[name][start : start + len(objects)] = values
                digest.update(values.tobytes())
                start += len(objects)
        if "reading" in arrays:
            file["empty_reading"] = batches[0]["touch"]["empty_reading"]
        file.attrs.update(schema_version=SCHEMA_VERSION, family=family, digest=digest.hexdigest())


def _common(batch: Mapping[str, store.Store], catalogue: Mapping[str, Mapping[str, str]]) -> list[str]:
    """The objects that all stores of a batch have, in their order."""
    held = [[str(name) for name in opened["object"]] for opened in batch.values()]
    return [name for name in held[0] if name in catalogue and all(name in names for names in held[1:])]


def _rows(opened: store.Store, source: Source, objects: list[str]) -> np.ndarray:
    """The rows of the named objects (o, ...), or (o, g, ...) of an array that has a row a grasp."""
    names = [str(name) for name in opened["object"]]
    if not objects:
        return np.empty(0, source.dtype)
    values = opened[source.name].astype(source.dtype, copy=False)
    if store.CONTRACT[source.stage].arrays[source.name].shape[0] == "og":
        values = values.reshape(len(names), -1, *values.shape[1:])
    return values[[names.index(name) for name in objects]]


def _check_finite(path: Path | str, source: Source, objects: list[str], values: np.ndarray) -> None:
    if values.dtype.kind != "f":
        return
    wrong = ~np.isfinite(values).all(axis=tuple(range(1, values.ndim)))
    if wrong.any():
        name = objects[int(np.flatnonzero(wrong)[0])]
        raise PackError(
            f"{path}: {source.stage} {source.name} of {name} has NaN or infinite values; "
            f"remove its store of {source.stage} and build it again, or leave the object out"
        )


class Pack:
    """A pack in memory: `pack["points"]` and the others as numpy arrays, first axis objects.

    Attributes:
        family: its name. digest: SHA-256 of all it holds in the file. objects, classes, splits: lists of (o,)
        names. grasps: g, grasps an object, 0 where the family sees none of a grasp. views: v, 0 likewise.
    """

    def __init__(self, arrays: dict[str, np.ndarray], family: str, digest: str, path: str = IN_MEMORY):
        self.path, self.family, self.digest = path, family, digest
        self.objects, self.classes, self.splits = (list(arrays.pop(key)) for key in ("object", "class", "split"))
        self.arrays = arrays
        self._check()
        of_grasps = next((key for key in ("success", "occluded") if key in arrays), None)
        self.grasps = arrays[of_grasps].shape[1] if of_grasps else 0
        self.views = arrays["views"].shape[1] if "views" in arrays else 0
        if "reading" in arrays:
            arrays["reading"] = np.where(
                arrays["success"][..., None, None, None], arrays["reading"], arrays["empty_reading"]
            )

    @classmethod
    def read(cls, path: Path | str, splits: Iterable[str] = SPLITS) -> "Pack":
        """The objects of some splits of a pack. Raises PackError, naming the file and the remedy, if it is
        missing, can't be read, or is of another schema version."""
        target = "/".join(Path(path).parts[-2:])
        if not Path(path).exists():
            raise PackError(f"{path} does not exist; build it with: snakemake {target}")
        try:
            with h5py.File(path, "r") as file:
                version = file.attrs.get("schema_version")
                if version != SCHEMA_VERSION:
                    raise PackError(
                        f"{path} has schema version {version}, but this palpate reads {SCHEMA_VERSION}; "
                        f"remove it and build it with: snakemake {target}"
                    )
                split = np.char.decode(file["split"][:].astype("S"), "utf-8")
                lengths = {name: len(file[name]) for name in file if name != "empty_reading"}
                if len(set(lengths.values())) > 1:
                    raise PackError(
                        f"{path} has arrays of different numbers of objects ({lengths}); "
                        f"remove it and build it with: snakemake {target}"
                    )
                rows = np.flatnonzero(np.isin(split, list(splits)))
                arrays = {name: _read(file[name], rows) for name in file}
                return cls(arrays, str(file.attrs["family"]), str(file.attrs["digest"]), str(path))
        except (OSError, KeyError) as error:
            raise PackError(
                f"{path} can't be read ({error}); remove it and build it with: snakemake {target}"
            ) from error

    def _check(self) -> None:
        """Raises PackError, naming the object, if a value is NaN, infinite, or out of `LIMITS`."""
        target = "/".join(Path(self.path).parts[-2:])
        again = "" if self.path == IN_MEMORY else f"; remove it and build it with: snakemake {target}"
        for name, values in self.arrays.items():
            if name == "empty_reading":
                continue
            if values.dtype.kind != "f":
                continue
            limit = LIMITS.get(name, np.inf)
            # NaN compares false.
            wrong = ~((np.abs(values) <= limit) & (np.abs(values) < np.inf)).reshape(len(values), -1).all(axis=1)
            if wrong.any():
                number = int(np.flatnonzero(wrong)[0])
                raise PackError(
                    f"{self.path}: {name} of {self.objects[number]} is NaN, infinite or above {limit:g}{again}"
                )

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self.arrays:
            raise PackError(f"{self.path} of family {self.family} has no {name}")
        return self.arrays[name]

    def __contains__(self, name: str) -> bool:
        return name in self.arrays

    def __len__(self) -> int:
        return len(self.objects)

    def of_split(self, *splits: str) -> list[int]:
        """Numbers of the objects of these splits, in the catalogue's order."""
        return [number for number, split in enumerate(self.splits) if split in splits]


def _read(dataset: h5py.Dataset, rows: np.ndarray) -> np.ndarray:
    if dataset.name == "/empty_reading":
        return dataset[:]
    if dataset.dtype.kind in "SO":
        return np.char.decode(dataset[:].astype("S"), "utf-8")[rows]
    if len(rows) == len(dataset):
        return dataset[:]
    return np.stack([dataset[row] for row in rows]) if len(rows) else np.empty((0, *dataset.shape[1:]), dataset.dtype)
