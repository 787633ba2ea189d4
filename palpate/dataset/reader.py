"""A run's dataset: every store, joined over batches, read only where it is looked at.

dataset = palpate.Dataset("results/default")
grasp = dataset["bottle-0007"].grasps[0]
grasp.reading, grasp.success, grasp.points
"""

import csv
from collections.abc import Iterable, Iterator, Sequence
from functools import cache, cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from palpate.store.contract import CONTRACT, SENSOR_NAMES
from palpate.store.files import Store, StoreError

# In the order in which an object goes through them; `released` reads a dataset that was not made here.
STAGES = ("released", "meshes", *CONTRACT)
# What the target `dataset` builds: other stores are made from these, of all of their objects or of some.
DATASET_STAGES = ("released", "meshes", "surface", "grasps", "touch", "vision")


class Entry(NamedTuple):
    """One object's row of `catalogue.csv`."""

    object: str
    class_name: str
    split: str
    batch: str


def read_rows(path: Path) -> list[dict[str, str]]:
    """Rows of a table with a header."""
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


class Run:
    """The files of one run, shared by a dataset, its views and its records.

    Safe to pickle and to fork: nothing stays open, and what is remembered is small (names, array headers).
    """

    def __init__(self, folder: Path | str):
        self.folder = Path(folder)
        self._stores: dict[Path, Store] = {}
        self._objects: dict[tuple[str, str], dict[str, int]] = {}

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_stores": {}}

    def catalogue(self) -> dict[str, Entry]:
        """Rows of `catalogue.csv` by object, in its order. Raises StoreError if it is missing or broken."""
        return self._catalogue

    @cached_property
    def _catalogue(self) -> dict[str, Entry]:
        path = self.folder / "catalogue.csv"
        if not path.exists():
            raise StoreError(f"{path} does not exist; name a run's folder, or build it with: snakemake")
        try:
            rows = [Entry(row["object"], row["class"], row["split"], row["batch"]) for row in read_rows(path)]
        except KeyError as error:
            raise StoreError(f"{path} has no column {error}; remove it and build it with: snakemake") from None
        return {entry.object: entry for entry in rows}

    @cached_property
    def batches(self) -> list[str]:
        """Names of the catalogue's batches. Files of others are left from an earlier config."""
        return list(dict.fromkeys(entry.batch for entry in self._catalogue.values()))

    def rejections(self, batch: str | None = None, stages: Iterable[str] | None = None) -> list[dict[str, str]]:
        """Rows object, stage, reason, of one batch or of all, at some stages or at any.

        Of `rejected/<stage>/<batch>.csv`, or of `rejected.csv` if no stage has written its own yet.
        """
        found = sorted(path.name for path in self.folder.glob("rejected/*"))
        batches = self.batches if batch is None else [batch]
        paths = [self.folder / f"rejected/{stage}/{name}.csv" for stage in found for name in batches]
        paths = [path for path in paths if path.exists()] or [self.folder / "rejected.csv"]
        rows = [row for path in paths if path.exists() for row in read_rows(path)]
        return rows if stages is None else [row for row in rows if row["stage"] in set(stages)]

    def rejected(self, stages: Iterable[str] | None = None) -> set[str]:
        """Objects rejected so far, at some stages or at any."""
        return {row["object"] for row in self.rejections(stages=stages)}

    def has(self, stage: str) -> bool:
        """Whether any batch of this stage is there."""
        return any((self.folder / CONTRACT[stage].path(batch)).exists() for batch in self.batches)

    def path(self, stage: str, batch: str) -> Path:
        """Path of one batch's store; StoreError if the run has nothing of this stage."""
        if not self.has(stage):
            raise StoreError(f"{self.folder} has no {stage}; build it with: snakemake --cores 2 dataset")
        return self.folder / CONTRACT[stage].path(batch)

    def store(self, stage: str, batch: str) -> Store:
        """One batch's store, remembered."""
        path = self.folder / CONTRACT[stage].path(batch)
        if path not in self._stores:
            self._stores[path] = Store(self.path(stage, batch))
        return self._stores[path]

    def objects(self, stage: str, batch: str) -> dict[str, int]:
        """Row of each object in one batch's store, remembered."""
        key = (stage, batch)
        if key not in self._objects:
            names = self.store(*key).get("object")
            self._objects[key] = {str(name): row for row, name in enumerate(names)}
        return self._objects[key]

    def rows(self, stage: str, entry: Entry, name: str) -> range:
        """Rows of the object in array `name`: one, or one a grasp."""
        objects = self.objects(stage, entry.batch)
        store = self.store(stage, entry.batch)
        if entry.object in objects:
            per_object = store.header(name)[0][0] // len(objects)
            row = objects[entry.object]
            return range(row * per_object, (row + 1) * per_object)
        for row in self.rejections(entry.batch):
            if row["object"] == entry.object:
                raise StoreError(
                    f"{store.path} does not hold {entry.object}, which was rejected at {row['stage']}: "
                    f"{row['reason']}; open the dataset with this stage to leave it out"
                )
        raise StoreError(
            f"{store.path} does not hold {entry.object}, which the catalogue puts in {entry.batch}; "
            f"remove it and build it again with: snakemake {stage}/{store.path.name}"
        )


class Dataset(Sequence):
    """The objects of a run, by name, number, split or class; nothing but their names is read on opening.

    run: the run's folder, `results/<run>`. stages: those that the objects must have come through (`meshes`,
    or one with a store); by default what the target `dataset` builds. An object is left out if one of these
    rejected it, or has a store of its batch without it; what other stages could not use does not matter.
    Stages that have not been built are simply absent; asking for one of their arrays raises StoreError with
    the command that builds it. Raises ValueError for an unknown stage.
    """

    def __init__(self, run: Path | str, stages: Iterable[str] = DATASET_STAGES):
        self._run = Run(run)
        self._asked = tuple(stages)
        if unknown := sorted(set(self._asked) - set(STAGES)):
            raise ValueError(f"no stage {', '.join(unknown)}: expected some of {', '.join(STAGES)}")
        self._entries = self._usable()

    def _usable(self) -> dict[str, Entry]:
        """The catalogue less what the stages asked for rejected, and less what their stores do not hold."""
        run = self._run
        gone = run.rejected(self._asked)
        stores = [(stage, spec) for stage, spec in CONTRACT.items() if stage in self._asked]

        def held(entry: Entry) -> bool:
            return all(
                entry.object in run.objects(stage, entry.batch)
                for stage, spec in stores
                if (run.folder / spec.path(entry.batch)).exists()
            )

        return {name: entry for name, entry in run.catalogue().items() if name not in gone and held(entry)}

    def _view(self, entries: Iterable[Entry]) -> "Dataset":
        view = object.__new__(Dataset)
        view._run, view._asked = self._run, self._asked
        view._entries = {entry.object: entry for entry in entries}
        return view

    @property
    def objects(self) -> list[str]:
        """Names of the objects, in the catalogue's order."""
        return list(self._entries)

    @property
    def classes(self) -> list[str]:
        """Names of the classes, sorted."""
        return sorted({entry.class_name for entry in self._entries.values()})

    @property
    def stages(self) -> list[str]:
        """The stages that this run has a store of."""
        return [stage for stage in CONTRACT if self._run.has(stage)]

    def rejections(self) -> list[dict[str, str]]:
        """What these stages could not use, of all classes and splits: object, stage, reason."""
        return self._run.rejections(stages=self._asked)

    def split(self, name: str) -> "Dataset":
        """The objects of one split: train, validation or test."""
        return self._where("split", name)

    def of_class(self, name: str) -> "Dataset":
        """The objects of one class."""
        return self._where("class_name", name)

    def _where(self, column: str, value: str) -> "Dataset":
        values = {getattr(entry, column) for entry in self._run.catalogue().values()}
        if value not in values:
            raise KeyError(f"{value!r} is not one of {', '.join(sorted(values))}")
        return self._view(entry for entry in self._entries.values() if getattr(entry, column) == value)

    def select(self, objects: Iterable[str]) -> "Dataset":
        """The named objects, in the order given."""
        return self._view(self._entry(name) for name in objects)

    def _entry(self, name: str) -> Entry:
        if name in self._entries:
            return self._entries[name]
        if name in self._run.rejected(self._asked):
            raise KeyError(f"{name!r} was rejected; {self._run.folder / 'rejected.csv'} has the reason")
        raise KeyError(f"{name!r} is not among the {len(self)} objects of {self!r}")

    def array(self, stage: str, name: str) -> "JoinedArray":
        """One array of a stage as it is stored: these objects' rows, joined over batches, not yet read."""
        spec = CONTRACT[stage].arrays[name]
        if spec.shape[0] not in ("o", "og"):
            raise KeyError(f"{stage} {name!r} {spec.axes} has no rows of objects")
        return JoinedArray(self._run, stage, name, list(self._entries.values()))

    def __len__(self) -> int:
        return len(self._entries)

    def __contains__(self, name: object) -> bool:
        return name in self._entries

    def __iter__(self) -> Iterator["ObjectRecord"]:
        return (ObjectRecord(self._run, entry) for entry in self._entries.values())

    def __getitem__(self, key: str | int | slice) -> "ObjectRecord | Dataset":
        """An object by its name or number; a slice gives a dataset."""
        if isinstance(key, str):
            return ObjectRecord(self._run, self._entry(key))
        entries = list(self._entries.values())[key]
        return self._view(entries) if isinstance(key, slice) else ObjectRecord(self._run, entries)

    def __repr__(self) -> str:
        classes = [entry.class_name for entry in self._entries.values()]
        counts = ", ".join(f"{name} {classes.count(name)}" for name in self.classes)
        return f"Dataset({str(self._run.folder)!r}: {len(self)} objects ({counts}); {', '.join(self.stages)})"


class JoinedArray(Sequence):
    """One array of many batches as if it were one; a row is read when it is asked for."""

    def __init__(self, run: Run, stage: str, name: str, entries: list[Entry]):
        self._run, self._stage, self._name, self._entries = run, stage, name, entries

    @cached_property
    def _rows(self) -> list[tuple[str, int]]:
        """Batch, and row in its store, of each row."""
        return [(entry.batch, row) for entry in self._entries for row in self._run.rows(self._stage, entry, self._name)]

    def _record(self) -> tuple[tuple[int, ...], np.dtype]:
        """Shape and type of one row; StoreError if there is no object to tell it by."""
        if not self._entries:
            raise StoreError(f"no object to take {self._stage} {self._name!r} of")
        store = self._run.store(self._stage, self._entries[0].batch)
        shape, dtype = store.header(self._name)
        return shape[1:], dtype

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the whole."""
        return (len(self), *self._record()[0])

    @property
    def dtype(self) -> np.dtype:
        """Type of its elements."""
        return self._record()[1]

    def __len__(self) -> int:
        return len(self._rows)

    def __getitem__(self, index: int | slice | Sequence[int] | np.ndarray) -> np.ndarray:
        """One row, or a stack of the rows of a slice or of a list of numbers (or of a boolean mask)."""
        if isinstance(index, int | np.integer):
            batch, row = self._rows[index]
            return self._run.store(self._stage, batch).get(self._name, row)
        wanted = np.arange(len(self))[index]
        rows = [self._rows[number] for number in wanted]
        shape, dtype = self._record()
        result = np.empty((len(rows), *shape), dtype)
        for start, stop in _consecutive(rows):
            batch, first = rows[start]
            store = self._run.store(self._stage, batch)
            result[start:stop] = store.get(self._name, slice(first, first + stop - start))
        return result

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return self[:] if dtype is None else self[:].astype(dtype)

    def __repr__(self) -> str:
        return f"JoinedArray({self._stage} {self._name!r}, shape {self.shape}, {self.dtype})"


def _consecutive(rows: list[tuple[str, int]]) -> Iterator[tuple[int, int]]:
    """Ranges of `rows` that are neighbours in one store, so that each is a single read."""
    start = 0
    for stop in range(1, len(rows) + 1):
        if stop == len(rows) or rows[stop] != (rows[stop - 1][0], rows[stop - 1][1] + 1):
            yield start, stop
            start = stop


@cache
def _names(axis: str) -> dict[str, str]:
    """Arrays with one row an object (`o`) or a grasp (`og`), and their stages."""
    return {
        name: stage
        for stage, spec in CONTRACT.items()
        for name, array in spec.arrays.items()
        if array.shape[0] == axis and name != "object"
    }


class _Rows:
    """Attributes that are the rows of one object, or of one of its grasps, in the contract's arrays."""

    axis: str  # "o" or "og"
    number = 0

    def __init__(self, run: Run, entry: Entry):
        self._run, self._entry = run, entry

    def _read(self, name: str) -> np.ndarray:
        """The row in array `name`, as it is stored."""
        stage = _names(self.axis)[name]
        row = self._run.rows(stage, self._entry, name)[self.number]
        return self._run.store(stage, self._entry.batch).get(name, row)

    def __getattr__(self, name: str) -> np.ndarray:
        if name not in _names(self.axis):
            known = ", ".join(sorted(_names(self.axis)))
            raise AttributeError(f"{type(self).__name__} has no {name!r}; its arrays are {known}")
        self.__dict__[name] = self._read(name)  # so that the next look does not read again
        return self.__dict__[name]

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *_names(self.axis)]


class ObjectRecord(_Rows):
    """One object: `class_name`, `split`, `batch`, `mesh` (folder), `grasps`, and by name every array of the
    contract with one row an object: `points`, `attempts`, `unoccluded`, `unoccluded_mask`,
    `unoccluded_depth`.
    """

    axis = "o"

    @property
    def name(self) -> str:
        """Its name in the catalogue."""
        return self._entry.object

    @property
    def class_name(self) -> str:
        """Its class."""
        return self._entry.class_name

    @property
    def split(self) -> str:
        """Its split: train, validation or test."""
        return self._entry.split

    @property
    def batch(self) -> str:
        """The batch that holds it."""
        return self._entry.batch

    @property
    def mesh(self) -> Path:
        """Folder of its meshes, which are in its own frame: centred at the origin, not at (0, 0, 0.6)."""
        return self._run.folder / "meshes" / self.batch / self.name

    @cached_property
    def grasps(self) -> list["GraspRecord"]:
        """Its grasps, as many as the first stage that has them says."""
        names = _names("og")
        name = next((name for name, stage in names.items() if self._run.has(stage)), "palm_pose")
        rows = self._run.rows(names[name], self._entry, name)
        return [GraspRecord(self._run, self._entry, number) for number in range(len(rows))]

    def __repr__(self) -> str:
        return f"ObjectRecord({self.name!r}, class {self.class_name}, {self.split}, {self.batch})"


class GraspRecord(_Rows):
    """One grasp: by name every array of the contract with one row a grasp, among them `palm_pose`,
    `joint_positions`, `penetration`, `success`, `position`, `rotation`, `depth`, `occluded`, `occluded_mask`.

    Arrays with one row a sensor are in the order of `sensors`. `reading` and `points` differ from the store:
    an untouched sensor reads the empty gel, and the clouds are cut at their count.
    """

    axis = "og"

    def __init__(self, run: Run, entry: Entry, number: int):
        super().__init__(run, entry)
        self.number = number

    @property
    def object(self) -> ObjectRecord:
        """The object that is grasped."""
        return ObjectRecord(self._run, self._entry)

    @cached_property
    def sensors(self) -> tuple[str, ...]:
        """Names of the hand's sensors; the Allegro's for a dataset that came without its hands."""
        if not self._run.has("grasps"):
            return SENSOR_NAMES
        names = self._run.store("grasps", self._entry.batch).get("hand/sensor_names")
        return tuple(str(name) for name in names)

    @cached_property
    def reading(self) -> np.ndarray:
        """Images of the four gels (4, 100, 100, 3) uint8."""
        stored = self._read("reading")
        empty = self._run.store("touch", self._entry.batch).get("empty_reading")
        return np.where(self.success[:, None, None, None], stored, empty)

    @cached_property
    def points(self) -> list[np.ndarray]:
        """The four local clouds (count, 3) float32 in the world frame; no points for an untouched sensor."""
        stored = self._read("points")
        return [cloud[:count] for cloud, count in zip(stored, self.point_count, strict=True)]

    def __repr__(self) -> str:
        return f"GraspRecord({self._entry.object!r}, {self.number})"
