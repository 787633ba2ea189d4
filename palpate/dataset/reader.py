"""A run's dataset: every store, joined over batches, read lazily; its objects, and their grasps, frames and presses."""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, cast, overload

import numpy as np

from palpate.camera import Camera
from palpate.catalogue import SPLITS, CatalogueEntry
from palpate.configuration import nearest, not_among
from palpate.dataset.grasps import GraspDataset, PressDataset
from palpate.dataset.run import Run, shaded
from palpate.rebuild_command import rebuild_advice
from palpate.sensor import Sensor
from palpate.stages import DATASET_STAGES, RELEASED, STAGES
from palpate.store.contract import CONTRACT, SENSOR_NAMES, arrays_by_name
from palpate.store.files import Store, StoreError

if TYPE_CHECKING:
    import pandas

    from palpate.hand import Hand

Index = int | slice | Sequence[int] | np.ndarray


class JoinedArray(Sequence):
    """One array of many batches as if it were one, `(o, ...)` or `(o, g, ...)`; read where it is indexed. Values are as
    they are stored, but for `reading`: a sensor that touched nothing reads the empty gel, which stores omit."""

    def __init__(self, run: Run, stage: str, name: str, entries: list[CatalogueEntry]):
        self._run, self._stage, self._name, self._entries = run, stage, name, entries
        self._spec = CONTRACT[stage].arrays[name]

    def _record(self) -> tuple[tuple[int, ...], np.dtype]:
        """Shape and type of one object's record; StoreError if there is no object to tell it by."""
        if not self._entries:
            what = f"{self._stage} {self._name!r}"
            raise StoreError(f"{self._run.folder}: no object to take {what} of; rejected.csv says why")
        shape, dtype = self._run.store(self._stage, self._entries[0].batch).header(self._name)
        return shape[1:], dtype

    @property
    def shape(self) -> tuple[int, ...]:
        return (len(self), *self._record()[0])

    @property
    def dtype(self) -> np.dtype:
        return self._record()[1]

    @property
    def attrs(self) -> dict[str, Any]:
        """What the contract says of the array (stage, axes, unit, meaning), and the attributes of the first store.
        Those are units, frames, seed, schema version, digest of the config and versions of what made it."""
        spec = {"stage": self._stage, "axes": self._spec.axes, "unit": self._spec.unit, "meaning": self._spec.meaning}
        return spec | (self._run.store(self._stage, self._entries[0].batch).attributes if self._entries else {})

    def __len__(self) -> int:
        return len(self._entries)

    def __getitem__(self, index: Index | tuple) -> np.ndarray:  # type: ignore[override]  # one type, however indexed
        """Indexes as numpy does: numbers and slices, and in the first place also one list or mask of objects. Only the
        chunks that these need are read. Raises IndexError for an index out of range and for any other, which the result
        takes: `array[:][mask]`. Raises StoreError if objects differ in shape."""
        first, *further = (index if isinstance(index, tuple) else (index,)) or (slice(None),)
        if not all(isinstance(part, int | np.integer | slice) for part in further):
            raise IndexError(f"{self!r} takes numbers and slices, and one list of objects in the first place")
        if isinstance(first, int | np.integer):
            return self._run.read(self._stage, self._name, self._entries[first], tuple(further))
        entries = [self._entries[number] for number in np.arange(len(self))[first]]
        records = (self._run.read(self._stage, self._name, entry, tuple(further)) for entry in entries)
        if self._spec.dtype == "string":
            return np.array([*records], dtype=str)
        shape, dtype = self._record()
        result = np.empty((len(entries), *np.broadcast_to(0, shape)[tuple(further)].shape), dtype)
        for place, (entry, values) in enumerate(zip(entries, records, strict=True)):
            if values.shape != result.shape[1:]:
                paths = [self._run.store(self._stage, other.batch).path for other in (entry, self._entries[0])]
                shapes = f"{self._name} of an object is {values.shape}, but {result.shape[1:]} in {paths[1]}"
                raise StoreError(f"{paths[0]}: {shapes}; build both again from one config")
            result[place] = values
        return result

    def __repr__(self) -> str:
        if not self._entries:
            return f"JoinedArray({self._stage} {self._name!r} {self._spec.axes}, no object)"
        unit = f", {self._spec.unit}" if self._spec.unit else ""
        return f"JoinedArray({self._stage} {self._name!r} {self._spec.axes}, shape {self.shape}, {self.dtype}{unit})"


class Dataset(Sequence):
    """The objects of a run, by name, number, split or class; nothing but their names is read on opening.
    run: the run's folder, `results/<run>`. stages: those that the objects must have come through (`meshes`, or one with
    a store); by default what the target `dataset` builds. An object is omitted if one of these, or of those that they
    read, rejected it. Asking for an array of a stage that has not been built raises StoreError with the command that
    builds it. Raises ValueError for an unknown stage."""

    def __init__(self, run: Path | str, stages: Iterable[str] = DATASET_STAGES):
        self._run = Run(run)
        self._required = tuple(stages)
        if unknown := sorted(set(self._required) - {RELEASED, *STAGES}):
            raise ValueError(f"stage {not_among(unknown[0], [RELEASED, *STAGES])}")
        self._entries = self._run.usable(self._required)
        self._run.require_config(self.folder / "catalogue.csv")

    def _view(self, entries: Iterable[CatalogueEntry]) -> "Dataset":
        view = object.__new__(Dataset)
        view._run, view._required = self._run, self._required
        view._entries = {entry.object: entry for entry in entries}
        return view

    @property
    def folder(self) -> Path:
        """The run's folder."""
        return self._run.folder

    @property
    def name(self) -> str:
        """The run's name: that of its folder."""
        return self.folder.resolve().name

    @property
    def config(self) -> dict[str, Any]:
        """The config that the run was last started with; empty if the run does not have it."""
        return self._run.config

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
        return self._run.stages

    def rejections(self) -> list[dict[str, str]]:
        """Rows object, stage, reason of what these stages rejected, in all classes and splits."""
        return self._run.rejections(stages=self._required)

    def split(self, name: str) -> "Dataset":
        """The objects of one split: train, validation or test; it may have none. Raises KeyError for another name."""
        if name not in SPLITS:
            raise KeyError(not_among(name, SPLITS))
        return self._view(entry for entry in self._entries.values() if entry.split == name)

    def of_class(self, name: str) -> "Dataset":
        """The objects of one class. Raises KeyError, with the nearest names, for an unknown one."""
        classes = sorted({entry.class_name for entry in self._run.catalogue.values()})
        if name not in classes:
            raise KeyError(not_among(name, classes))
        return self._view(entry for entry in self._entries.values() if entry.class_name == name)

    def select(self, objects: Iterable[str]) -> "Dataset":
        """The named objects, in the order given."""
        return self._view(self._entry(name) for name in objects)

    def _entry(self, name: str) -> CatalogueEntry:
        if name in self._entries:
            return self._entries[name]
        if name in self._run.rejected(self._required):
            raise KeyError(f"{name!r} was rejected; {self._run.folder / 'rejected.csv'} has the reason")
        hint = nearest(name, self._entries) or f"; the first are {', '.join(self.objects[:5]) or 'none'}"
        raise KeyError(f"{name!r} is not among the {len(self)} objects of {self!r}{hint}")

    def array(self, stage: str, name: str) -> JoinedArray:
        """One array of a stage, joined over batches and read where it is indexed: these objects' rows, in their order.
        Its shape is the contract's, (o, ...) or (o, g, ...). Its values are as they are stored, but for readings: a
        sensor that touched nothing reads the empty gel. Raises KeyError, with the names that there are, for another
        stage or array, and if the array does not have a row an object."""
        if stage not in CONTRACT:
            raise KeyError(f"stage with arrays: {not_among(stage, CONTRACT)}")
        if name not in CONTRACT[stage].arrays:
            raise KeyError(f"array of {stage}: {not_among(name, CONTRACT[stage].arrays)}")
        spec = CONTRACT[stage].arrays[name]
        if not spec.of_objects:
            raise KeyError(f"{stage} {name!r} {spec.axes} has no rows of objects")
        return JoinedArray(self._run, stage, name, list(self._entries.values()))

    def load(self, stage: str, name: str, dtype: np.dtype | str | None = None) -> np.ndarray:
        """One array of a stage, of all of these objects, in memory, converted to `dtype` if given. Raises StoreError if
        objects differ in shape, and, naming file, object and remedy, if a value is NaN or infinite where the contract
        has no such values (+inf is what depths have where nothing is in range)."""
        values, empty = self.array(stage, name)[:], CONTRACT[stage].arrays[name].fill
        if values.dtype.kind == "f":
            right = (np.isfinite(values) | (values == empty)).reshape(len(values), -1).all(axis=1)
            if not right.all():
                entry = list(self._entries.values())[int(right.argmin())]
                path = self._run.store(stage, entry.batch).path
                raise StoreError(f"{path}: {name} of {entry.object} is NaN or infinite; {rebuild_advice(path)}")
        return values if dtype is None else values.astype(dtype, copy=False)

    def grasps(
        self, split: str | None = None, arrays: Iterable[str] | None = None, camera: int | None = 0
    ) -> GraspDataset:
        """All grasps as a map-style dataset of dictionaries, for `torch.utils.data.DataLoader` as it is. split: train,
        validation or test; all by default. arrays: which to read, by their names in the dictionaries; all by default.
        camera: whose images are read; None for those of all, with an axis k. See `palpate.dataset.GraspDataset`."""
        entries = (self if split is None else self.split(split))._entries.values()
        return GraspDataset(self._run, entries, self._required, arrays, camera)

    def presses(self, split: str | None = None, arrays: Iterable[str] | None = None) -> PressDataset:
        """All presses, as `grasps`. Raises StoreError, with the command that builds them, for a run without."""
        entries = (self if split is None else self.split(split))._entries.values()
        return PressDataset(self._run, entries, self._required, arrays)

    def digests(self, stages: Collection[str] | None = None) -> dict[tuple[str, str], str]:
        """SHA-256 of what these objects' stores of some stages state of their files, by stage and batch.
        stages: by default those that the run has or should have, of those that the objects must have come through.
        Raises StoreError, with the command that builds it, if a store is missing."""
        if stages is None:
            stages = {*self._run.asked_stores, *self.stages} & {*self._required}
        batches = dict.fromkeys(entry.batch for entry in self._entries.values())
        stages = [name for name in CONTRACT if name in stages]
        return {(name, batch): self._run.store(name, batch).seal.digest for name in stages for batch in batches}

    def table(self) -> "pandas.DataFrame":
        """A row a grasp: object, class, split, batch, grasp, touches, and the object's row in `array`.
        grasp: its number, from 0. touches: how many sensors touch the object. So `dataset.array("touch", "depth")[row,
        grasp]` is that grasp's. A run without touches has a row an object, without grasp and touches."""
        import pandas

        rows = [(*entry[:4], row) for row, entry in enumerate(self._entries.values())]
        table = pandas.DataFrame(rows, columns=["object", "class", "split", "batch", "row"])
        stage, name = ("touch", "success") if "touch" in self.stages else ("grasps", "touches")
        if stage not in self.stages or not rows:
            return table
        touches = self.array(stage, name)[:].sum(axis=2)  # (o, g)
        table = table.loc[table.index.repeat(touches.shape[1])].reset_index(drop=True)
        table.insert(4, "grasp", np.tile(np.arange(touches.shape[1]), len(rows)))
        table.insert(5, "touches", touches.ravel())
        return table

    def require_current(self, path: Path) -> None:
        """Raise StoreError if a file of the run is not as it was written, or not made from what the run has now."""
        self._run.require_current(path)

    def cameras(self) -> np.ndarray:
        """(o, k, 3, 4) float64 projections of the k cameras, from homogeneous world coordinates (m) to pixels."""
        return self.load("vision", "intrinsics") @ self.load("vision", "extrinsics")

    def _touch(self) -> Store:
        if not self._entries:
            raise StoreError(f"{self!r}: no object whose touch store has the sensor; rejected.csv says why")
        return self._run.store("touch", next(iter(self._entries.values())).batch)

    @property
    def empty_reading(self) -> np.ndarray:
        """(r, c, 3) uint8 reading of an untouched sensor. Raises StoreError if there is no object."""
        return self._touch().empty_reading

    @property
    def sensor(self) -> Sensor:
        """The kind of touch sensor, as the touch store states it. Raises StoreError if there is no object."""
        return self._touch().sensor

    def __len__(self) -> int:
        return len(self._entries)

    def __contains__(self, name: object) -> bool:
        return name in self._entries

    def __iter__(self) -> Iterator["ObjectRecord"]:
        return (ObjectRecord(self._run, entry) for entry in self._entries.values())

    @overload
    def __getitem__(self, key: str | int) -> "ObjectRecord": ...
    @overload
    def __getitem__(self, key: slice) -> "Dataset": ...

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


class _Record:
    """Attributes that are the row of one object, or of one of its grasps, in the contract's arrays."""

    row = ""  # what it is: an "object", a "grasp", a "frame" or a "press"
    index: tuple[int | slice, ...]  # within the object's row
    stage_of: dict[str, str] = {}  # by the names of the arrays

    def __init_subclass__(cls) -> None:
        """Gives the class a property, with its shape, type and unit in `help()`, for each array of its rows."""
        leading = 1 if cls.row == "object" else 2
        arrays = arrays_by_name(cls.row) if cls.row else {}
        cls.stage_of = {name: stage for name, (stage, _) in arrays.items()}
        for name, (stage, spec) in arrays.items():
            if name not in vars(cls):
                # Leading axes are indexed, as is that of cameras.
                axes = replace(spec, shape=tuple(axis for axis in spec.shape[leading:] if axis != "k")).axes
                about = f"{axes} {spec.dtype}{spec.unit and f', {spec.unit}'}. {spec.meaning}. Of the {stage} store."
                about += " Not in every run." * spec.optional
                setattr(cls, name, property(partial(cls._read, name=name), doc=about))

    def __init__(self, run: Run, entry: CatalogueEntry, *grasp: int, camera: int = 0):
        self._run, self._entry, self._grasp, self.camera_number = run, entry, grasp, camera
        self.index = (*grasp, slice(None)) if self.row == "frame" else grasp
        self._values: dict[str, np.ndarray] = {}  # that were read

    @property
    def stages(self) -> list[str]:
        """The stages that the run has a store of."""
        return self._run.stages

    def _read(self, name: str) -> np.ndarray:
        """The row in array `name`, as it is stored, of the record's camera where it has an axis of them; read once."""
        if name not in self._values:
            stage = self.stage_of[name]
            of_camera = (self.camera_number,) if CONTRACT[stage].arrays[name].of_cameras else ()
            self._values[name] = self._run.read(stage, name, self._entry, (*self.index, *of_camera))
        return self._values[name]

    @cached_property
    def sensor(self) -> Sensor:
        """The kind of touch sensor that its depths and readings are of."""
        stage = {"frame": "frames", "press": "press"}.get(self.row, "touch")
        return self._run.store(stage, self._entry.batch).sensor

    @cached_property
    def cameras(self) -> int:
        """Number of the scene's cameras."""
        return self._run.store("vision", self._entry.batch).header("intrinsics")[0][1]

    def seen_by(self, number: int) -> Self:
        """The same object or grasp with the images of another of the `cameras`. Raises IndexError if there is none."""
        if number not in range(self.cameras):
            raise IndexError(f"{self!r} has no camera {number}: it has {self.cameras}, numbered from 0")
        return type(self)(self._run, self._entry, *self._grasp, camera=number)

    def __getattr__(self, name: str) -> np.ndarray:
        hint = nearest(name, dir(type(self)))
        raise AttributeError(f"{type(self).__name__} has no {name!r}{hint}; its arrays are {', '.join(self.stage_of)}")


class ObjectRecord(_Record):
    """One object: its `name`, `class_name`, `split` and `batch` in the catalogue, `mesh` (folder), `grasps`, and every
    array of the contract with one row an object. Shapes are in the symbols of docs/dataset.md. `normalised`: whether it
    has the one size of all, a diagonal of 0.5 m, and not its source's. Images, masks, depths and matrices are those of
    the scene's first camera; `seen_by(1)` gives the next one's."""

    row = "object"

    def __init__(self, run: Run, entry: CatalogueEntry, camera: int = 0):
        super().__init__(run, entry, camera=camera)
        self.name, self.class_name, self.split, self.batch = entry[:4]
        self.normalised = entry.normalised

    @property
    def mesh(self) -> Path:
        """Folder of its meshes, which are in its own frame: centred at the origin, not at (0, 0, 0.6)."""
        return self._run.meshes(self.batch) / self.name

    @property
    def vision_camera(self) -> Camera:
        """The camera of its images; `vision_camera.pose()` (4, 4), `.project(points)`, `.rays()`."""
        size = self._run.store("vision", self.batch).header("unoccluded")[0][2]
        return Camera.from_matrices(self.intrinsics, self.extrinsics, size)

    @property
    def drawn(self) -> dict[str, Any]:
        """Cameras, lights and background of its images as the config says them, if they were drawn; else empty."""
        return self._run.store("vision", self.batch).attributes.get("drawn", {}).get(self.name, {})

    @cached_property
    def hand(self) -> "Hand":
        """The hand that grasps it, as its store of grasps carries it. Raises StoreError if the run has no grasps."""
        from palpate.hand import Hand

        return Hand.from_arrays(cast("Mapping[str, np.ndarray]", self._run.store("grasps", self.batch)), prefix="hand/")

    @cached_property
    def grasps(self) -> list["GraspRecord"]:
        """Its grasps; their number is that of the first stage that has grasps."""
        numbers = range(self._run.grasps(self._entry))
        return [GraspRecord(self._run, self._entry, number, camera=self.camera_number) for number in numbers]

    @cached_property
    def presses(self) -> list["PressRecord"]:
        """Its presses, if the run's config has `press.count`."""
        return [PressRecord(self._run, self._entry, number) for number in range(self._run.presses(self._entry))]

    def __repr__(self) -> str:
        return f"ObjectRecord({self.name!r}, class {self.class_name}, {self.split}, {self.batch})"


class _Part(_Record):
    """A grasp, its frames, or a press of an object."""

    @property
    def number(self) -> int:
        """Its number among those of the object, from 0; of frames that of the grasp."""
        return self._grasp[0]

    @property
    def object(self) -> ObjectRecord:
        """The object that is touched, seen by the same camera."""
        return ObjectRecord(self._run, self._entry, self.camera_number)

    @property
    def vision_camera(self) -> Camera:
        """The camera of the object's images."""
        return self.object.vision_camera

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self._entry.object!r}, {self.number})"


class GraspRecord(_Part):
    """One grasp: every array of the contract with one row a grasp. Arrays with one row a sensor are in the order of
    `sensors`. `reading` and `points` differ from the store: an untouched sensor reads the empty gel, and the clouds are
    cut at their count. Shapes are in the symbols of docs/dataset.md (`palpate.store.contract.SYMBOLS`)."""

    row = "grasp"

    @cached_property
    def intrinsics(self) -> np.ndarray:
        """(3, 3) from x right, y down, z into the scene of the camera, m, to homogeneous pixels."""
        return self.object.intrinsics

    @cached_property
    def extrinsics(self) -> np.ndarray:
        """(3, 4) from homogeneous world coordinates, m, to x right, y down, z into the scene of the camera."""
        return self.object.extrinsics

    @cached_property
    def sensors(self) -> tuple[str, ...]:
        """Names of the hand's sensors; the Allegro's for a dataset that came without its hands."""
        if not self._run.has("grasps"):
            return SENSOR_NAMES
        return tuple(map(str, self._run.store("grasps", self._entry.batch).get("hand/sensor_names")))

    @property
    def frames(self) -> "FramesRecord":
        """Its closing, from the open hand to this grasp; nothing is read yet."""
        return FramesRecord(self._run, self._entry, self.number, camera=self.camera_number)

    @property
    def has_forces(self) -> bool:
        """Whether the hand closed with a grip: `sensor_force` and other arrays of antipodal grasps."""
        return "grasps" in self.stages and "sensor_force" in self._run.store("grasps", self._entry.batch)

    @cached_property
    def points(self) -> list[np.ndarray]:
        """s of (count, 3) float32, m. The local clouds, world frame; no points of a sensor that touched nothing."""
        stored = self._read("points")
        return [cloud[:count] for cloud, count in zip(stored, self.point_count, strict=True)]


class FramesRecord(_Part):
    """The frames of a grasp: its closing from the open hand to rest, every array of the contract with one row a frame.
    The last frame is the grasp. `occluded` has images of the frames `image_frame` only, by the record's camera; all
    other arrays have all `len(frames)`. Shapes are in the symbols of docs/dataset.md."""

    row = "frame"

    def __len__(self) -> int:
        return len(self.time)

    @property
    def has_touch(self) -> bool:
        """Whether the run has depths of its frames: `success`, `depth`, `reading`."""
        return "depth" in self._run.store("frames", self._entry.batch)

    @property
    def has_contacts(self) -> bool:
        """Whether the run has contacts of its frames: `contact_*` and `sensor_wrench`."""
        return "contact_count" in self._run.store("frames", self._entry.batch)

    @cached_property
    def reading(self) -> np.ndarray:
        """(f, s, r, c, 3) uint8, RGB. Images of the s gels: `depth` as the sensor shades it; it is not stored."""
        return shaded(self.depth, self.sensor)


class PressRecord(_Part):
    """One press of a sensor onto the object, without a hand: every array of the contract with one row a press, some
    with a row for each of the forces in `force`. Shapes are in the symbols of docs/dataset.md."""

    row = "press"

    @property
    def empty_reading(self) -> np.ndarray:
        """(r, c, 3) uint8 reading of the untouched gel."""
        return self._run.store("press", self._entry.batch).empty_reading

    @cached_property
    def points(self) -> np.ndarray:
        """(n, 3) float32, m. The surface points before the sensor's image, of the finite pixels of `depth`; world."""
        from palpate.touch import local_points

        return local_points(self.depth, self.position, self.rotation, self.sensor)
