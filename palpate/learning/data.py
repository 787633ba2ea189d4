"""The arrays of an experiment in memory, read once from a run's stores, for training and evaluation. Shapes are the
contract's (docs/dataset.md), in the world frame; silhouettes have those of masks, `image_camera` is (o, k, 3, 4)."""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from pathlib import Path

import numpy as np

from palpate.catalogue import SPLITS
from palpate.dataset import Dataset
from palpate.experiments import Experiment
from palpate.learning.inputs import Input, inputs, stages
from palpate.sensor import DIGIT, Sensor
from palpate.strategies import CAMERAS


class ExperimentDataError(ValueError):
    """A run's data can't be used for an experiment; the message names them and what to do."""


class ExperimentData:
    """Objects and their arrays in memory: `data["points"]` and the others as numpy arrays, first axis objects.
    arrays: by name, among them `object`, `class` and `split` (o,). source: their name for messages. sensor: of
    the touches. one_size: whether all objects were scaled to one size. If not, `largest` is the diagonal (m) of the box
    of the largest object of the train split. grasps: of an object, 0 if no array has that axis; hand_sensors: of a
    grasp, or None. Raises ExperimentDataError, naming the object, if a value is NaN or infinite."""

    def __init__(
        self,
        arrays: Mapping[str, Sequence[str] | np.ndarray],
        source: str = "the data in memory",
        sensor: Sensor = DIGIT,
        one_size: bool = True,
    ):
        self.source, self.sensor, names = source, sensor, ("object", "class", "split")
        self.objects, self.classes, self.splits = ([str(name) for name in arrays[key]] for key in names)
        self.arrays = {name: np.asarray(values) for name, values in arrays.items() if name not in names}
        grasped = next((name for name in ("success", "occluded", "occluded_silhouette") if name in self), None)
        self.grasps = self[grasped].shape[1] if grasped else 0
        self.hand_sensors = self["success"].shape[2] if "success" in self else None
        for name, values in self.arrays.items():
            finite = np.isfinite(values.reshape(len(values), -1)).all(axis=1) if values.dtype.kind == "f" else True
            if not np.all(finite):
                first = self.objects[int(np.argmin(finite))]
                raise ExperimentDataError(f"{source}: {name} of {first} is NaN or infinite")
        sized = [] if one_size else [self["points"][number].astype(float) for number in self.of_split("train")]
        self.largest = max((float(np.linalg.norm(np.ptp(points, axis=0))) for points in sized), default=None)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of all names and arrays."""
        digest = hashlib.sha256("\0".join([*self.objects, *self.classes, *self.splits]).encode())
        for name, values in self.arrays.items():
            digest.update(f"\0{name} {values.dtype} {values.shape}".encode())
            digest.update(np.ascontiguousarray(values).data)
        return digest.hexdigest()

    def images(self, experiment: Experiment) -> int:
        """Images that an experiment has of one object, or of one grasp: its views, or cameras; 0 without vision."""
        return self[CAMERAS[experiment.vision]].shape[1] if experiment.has_vision else 0

    def common_camera(self, experiment: Experiment) -> np.ndarray | None:
        """(3, 4) float32 the camera of all images of an experiment; None if there are several, or no images."""
        if not experiment.has_vision:
            return None
        cameras = self[CAMERAS[experiment.vision]].reshape(-1, 3, 4)
        return cameras[0] if (cameras == cameras[0]).all() else None

    def image_size(self, experiment: Experiment) -> int | None:
        """Width and height, pixels, of an experiment's images; None without vision."""
        return self[experiment.vision].shape[-2] if experiment.has_vision else None

    @classmethod
    def load(
        cls, run: Path | str, experiment: Experiment, splits: Iterable[str] = SPLITS, training: bool = False
    ) -> "ExperimentData":
        """The data of an experiment: the objects of some splits of a run. training: with what only trainings take.
        Raises ExperimentDataError if no object of them is in all stores; StoreError, naming the file and the remedy,
        for a bad store."""
        return cls.read(Dataset(run, stages(experiment, training)), inputs(experiment, training), splits)

    @classmethod
    def read(cls, dataset: Dataset, arrays: Sequence[Input], splits: Iterable[str] = SPLITS) -> "ExperimentData":
        """Some arrays of the objects of some splits of a dataset. Raises what `load` raises."""
        splits = list(splits)
        records = [record for record in dataset if record.split in splits]
        chosen = dataset.select(record.name for record in records)
        if not records:
            needed = ", ".join(dict.fromkeys(item.stage for item in arrays))
            nothing = f"no object of {' or '.join(splits)} is in all of {needed}"
            raise ExperimentDataError(f"{dataset!r}: {nothing}: more objects are needed; rejected.csv says why")
        loaded: dict[str, Sequence[str] | np.ndarray] = {item.name: _read(chosen, item) for item in arrays}
        loaded |= {
            "object": [record.name for record in records],
            "class": [record.class_name for record in records],
            "split": [record.split for record in records],
        }
        touched, one_size = any(item.stage == "touch" for item in arrays), all(record.normalised for record in records)
        return cls(loaded, repr(chosen), dataset.sensor if touched else DIGIT, one_size)

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self.arrays:
            raise ExperimentDataError(f"{self.source}: the experiment takes no {name}")
        return self.arrays[name]

    def __contains__(self, name: str) -> bool:
        return name in self.arrays

    def __len__(self) -> int:
        return len(self.objects)

    def of_split(self, *splits: str) -> list[int]:
        """Numbers of the objects of these splits, in the catalogue's order."""
        return [number for number, split in enumerate(self.splits) if split in splits]


def _read(dataset: Dataset, item: Input) -> np.ndarray:
    if item.name == "image_camera":
        return dataset.cameras().astype(item.dtype)
    if item.name == "hand_silhouette":
        return np.isfinite(dataset.load("vision", "occluded_depth")) & (dataset.load("vision", "occluded_mask") == 0)
    return dataset.load(item.stage, item.array, item.dtype)
