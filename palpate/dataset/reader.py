"""A run's dataset: every store, joined over batches, read lazily.

dataset = palpate.Dataset("results/default")
grasp = dataset["bottle-0007"].grasps[0]
grasp.reading, grasp.success, grasp.points
"""

from collections.abc import Iterable, Iterator, Sequence
from functools import cache, cached_property
from pathlib import Path

import numpy as np

from palpate.catalogue import CatalogueEntry
from palpate.dataset.arrays import JoinedArray, fill_untouched
from palpate.dataset.run import Run
from palpate.sensor import Sensor
from palpate.store.contract import CONTRACT, SENSOR_NAMES
from palpate.store.files import StoreError

# In the order in which an object goes through them; `released` reads a dataset that was not made here.
STAGES = ("released", "meshes", *CONTRACT)
# What the target `dataset` builds: other stores are made from these, of all of their objects or of some.
DATASET_STAGES = ("released", "meshes", "surface", "grasps", "touch", "vision")


class Dataset(Sequence):
    """The objects of a run, by name, number, split or class; nothing but their names is read on opening.

    run: the run's folder, `results/<run>`. stages: those that the objects must have come through (`meshes`,
    or one with a store); by default what the target `dataset` builds. An object is omitted if one of these
    rejected it, or has a store of its batch without it; rejections of other stages do not matter.
    Stages that have not been built are absent; asking for one of their arrays raises StoreError with the
    command that builds it. Raises ValueError for an unknown stage.
    """

    def __init__(self, run: Path | str, stages: Iterable[str] = DATASET_STAGES):
        self._run = Run(run)
        self._asked = tuple(stages)
        if unknown := sorted(set(self._asked) - set(STAGES)):
            raise ValueError(f"no stage {', '.join(unknown)}: expected some of {', '.join(STAGES)}")
        self._entries = self._usable()

    def _usable(self) -> dict[str, CatalogueEntry]:
        """The catalogue without the objects that these stages rejected or whose stores lack them."""
        run = self._run
        rejected = run.rejected(self._asked)
        stores = [(stage, spec) for stage, spec in CONTRACT.items() if stage in self._asked]

        def in_all_stores(entry: CatalogueEntry) -> bool:
            return all(
                entry.object in run.objects(stage, entry.batch)
                for stage, spec in stores
                if (run.folder / spec.path(entry.batch)).exists()
            )

        return {name: entry for name, entry in run.catalogue.items() if name not in rejected and in_all_stores(entry)}

    def _view(self, entries: Iterable[CatalogueEntry]) -> "Dataset":
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
        """Rows object, stage, reason of what these stages rejected, in all classes and splits."""
        return self._run.rejections(stages=self._asked)

    def split(self, name: str) -> "Dataset":
        """The objects of one split: train, validation or test."""
        return self._where("split", name)

    def of_class(self, name: str) -> "Dataset":
        """The objects of one class."""
        return self._where("class_name", name)

    def _where(self, column: str, value: str) -> "Dataset":
        values = {getattr(entry, column) for entry in self._run.catalogue.values()}
        if value not in values:
            raise KeyError(f"{value!r} is not one of {', '.join(sorted(values))}")
        return self._view(entry for entry in self._entries.values() if getattr(entry, column) == value)

    def select(self, objects: Iterable[str]) -> "Dataset":
        """The named objects, in the order given."""
        return self._view(self._entry(name) for name in objects)

    def _entry(self, name: str) -> CatalogueEntry:
        if name in self._entries:
            return self._entries[name]
        if name in self._run.rejected(self._asked):
            raise KeyError(f"{name!r} was rejected; {self._run.folder / 'rejected.csv'} has the reason")
        raise KeyError(f"{name!r} is not among the {len(self)} objects of {self!r}")

    @property
    def grasps_per_object(self) -> int:
        """Grasps of each object, by the first stage that has grasps. Raises StoreError if there is no object."""
        if not self._entries:
            raise StoreError(f"{self!r}: no object to count grasps of; rejected.csv says why")
        return self._run.grasps(next(iter(self._entries.values())))

    def array(self, stage: str, name: str) -> JoinedArray:
        """One array of a stage, joined over batches and read where it is indexed: these objects' rows, in their order.

        Its shape is the contract's, (o, ...) or (o, g, ...), and its values are as they are stored. Raises KeyError
        if the array does not have a row an object.
        """
        spec = CONTRACT[stage].arrays[name]
        if not spec.of_objects:
            raise KeyError(f"{stage} {name!r} {spec.axes} has no rows of objects")
        return JoinedArray(self._run, stage, name, list(self._entries.values()))

    def load(self, stage: str, name: str, dtype: np.dtype | str | None = None) -> np.ndarray:
        """One array of a stage, of all of these objects, in memory: checked, then converted to `dtype` if given.

        Raises StoreError, naming file, object and remedy, if a value is NaN, infinite or too large where it must not
        be (see `JoinedArray.load`), and if objects differ in shape.
        """
        values = self.array(stage, name).load()
        return values if dtype is None else values.astype(dtype, copy=False)

    def readings(self) -> np.ndarray:
        """(o, g, s, r, r, 3) uint8 readings in memory; a sensor that touched nothing reads the empty gel."""
        return fill_untouched(self.load("touch", "reading"), self.load("touch", "success"), self.empty_reading)

    @property
    def empty_reading(self) -> np.ndarray:
        """(r, r, 3) uint8 reading of an untouched sensor. Raises StoreError if there is no object."""
        if not self._entries:
            raise StoreError(f"{self!r}: no object whose touch store has the empty reading; rejected.csv says why")
        return self._run.store("touch", next(iter(self._entries.values())).batch).get("empty_reading")

    @property
    def sensor(self) -> Sensor:
        """The kind of touch sensor that the readings are of, as their store states it. Raises StoreError if there is
        no object."""
        if not self._entries:
            raise StoreError(f"{self!r}: no object whose touch store has the sensor; rejected.csv says why")
        return self._run.sensor(next(iter(self._entries.values())).batch)

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


@cache
def _stage_of_arrays(of_grasps: bool) -> dict[str, str]:
    """The stage of each array with a row a grasp, or of each other array with a row an object."""
    return {
        name: stage
        for stage, spec in CONTRACT.items()
        for name, array in spec.arrays.items()
        if array.of_objects and array.of_grasps == of_grasps and name != "object"
    }


class _Record:
    """Attributes that are the row of one object, or of one of its grasps, in the contract's arrays."""

    of_grasps = False
    index: tuple[int, ...] = ()  # within the object's row

    def __init__(self, run: Run, entry: CatalogueEntry):
        self._run, self._entry = run, entry

    def _read(self, name: str) -> np.ndarray:
        """The row in array `name`, as it is stored."""
        stage = _stage_of_arrays(self.of_grasps)[name]
        row = self._run.row(stage, self._entry)
        return self._run.store(stage, self._entry.batch).get(name, (row, *self.index))

    def __getattr__(self, name: str) -> np.ndarray:
        if name not in _stage_of_arrays(self.of_grasps):
            known = ", ".join(sorted(_stage_of_arrays(self.of_grasps)))
            raise AttributeError(f"{type(self).__name__} has no {name!r}; its arrays are {known}")
        self.__dict__[name] = self._read(name)  # so that the next look does not read again
        return self.__dict__[name]

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *_stage_of_arrays(self.of_grasps)]


class ObjectRecord(_Record):
    """One object: `class_name`, `split`, `batch`, `mesh` (folder), `grasps`, and by name every array of the
    contract with one row an object: `points`, `scale`, `attempts`, `unoccluded`, `unoccluded_mask`,
    `unoccluded_depth`; `normalised` says whether it has the one size of all.
    """

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
    def normalised(self) -> bool:
        """Whether it was scaled to the one size of all, a diagonal of 0.5 m; otherwise it has its source's size."""
        return self._entry.normalised

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
        """Its grasps; their number is that of the first stage that has grasps."""
        return [GraspRecord(self._run, self._entry, number) for number in range(self._run.grasps(self._entry))]

    def __repr__(self) -> str:
        return f"ObjectRecord({self.name!r}, class {self.class_name}, {self.split}, {self.batch})"


class GraspRecord(_Record):
    """One grasp: by name every array of the contract with one row a grasp, among them `palm_pose`,
    `joint_positions`, `penetration`, `success`, `position`, `rotation`, `depth`, `occluded`, `occluded_mask`.

    Arrays with one row a sensor are in the order of `sensors`. `reading` and `points` differ from the store:
    an untouched sensor reads the empty gel, and the clouds are cut at their count.
    """

    of_grasps = True

    def __init__(self, run: Run, entry: CatalogueEntry, number: int):
        super().__init__(run, entry)
        self.number = number
        self.index = (number,)

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
    def sensor(self) -> Sensor:
        """The kind of touch sensor that the readings are of."""
        return self._run.sensor(self._entry.batch)

    @cached_property
    def reading(self) -> np.ndarray:
        """Images of the gels (s, r, r, 3) uint8."""
        empty = self._run.store("touch", self._entry.batch).get("empty_reading")
        return fill_untouched(self._read("reading"), self.success, empty)

    @cached_property
    def points(self) -> list[np.ndarray]:
        """The s local clouds (count, 3) float32 in the world frame; no points for an untouched sensor."""
        stored = self._read("points")
        return [cloud[:count] for cloud, count in zip(stored, self.point_count, strict=True)]

    def __repr__(self) -> str:
        return f"GraspRecord({self._entry.object!r}, {self.number})"
