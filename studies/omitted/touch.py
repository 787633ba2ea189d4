"""Omissions of touch and its store: naive variants of the engine, and comparisons with it."""

import tempfile
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import zarr

from palpate import store, touch
from palpate.mesh import load_visual
from palpate.sensor import DIGIT
from palpate.touch import RayCaster, TouchReading
from studies.omitted.omission import Omission
from studies.scenes import scene_of
from studies.subjects import Subject

ATTRIBUTES = {"made_from": {}, "seed": 0, "sensor": DIGIT.description()}
FRAMES, FAR = 20, 0.08  # frames, and metres from the first to the last
UNTOUCHED = "a sensor touches nothing"


class EveryFace(RayCaster):
    """Traces faces outside the swept box, too."""

    def near_faces(self, origin: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """Indices of all faces."""
        return np.arange(len(self.mesh.triangles))


class EverySensor(RayCaster):
    """Traces sensors with no face near, too."""

    def _near(self, position: np.ndarray, rotation: np.ndarray) -> Iterator[tuple[Any, ...]]:
        """All sensors."""
        poses = zip(*self._in_object_frame(position, rotation), strict=True)
        return ((k, *pose) for k, pose in enumerate(poses))


class EveryPixelForSuccess(RayCaster):
    """Continues after the first pixel in range, where only success is needed."""

    def succeeds_early(self, origin: np.ndarray, rotation: np.ndarray) -> bool:
        """Never, so that all pixels are traced."""
        return False


def sense_every_reading(tracer: RayCaster, *sensors: np.ndarray) -> TouchReading:
    """As `touch.sense`, with the readings of sensors that touch nothing."""
    sensed = touch.sense(tracer, *sensors)
    for sensor in zip(*np.nonzero(~sensed.success), strict=True):
        sensed.reading[sensor] = touch.shade(sensed.depth[sensor])
    return sensed


class TouchSubject:
    """The sensors of all grasps of an object, and tracers of its mesh."""

    def __init__(self, run: Path, subject: Subject):
        self.name = subject.name
        self.scene, self.mesh = scene_of(run, subject), load_visual(subject.folder)
        self.sensors = self.scene.sensor_position, self.scene.sensor_rotation

    def tracer(self, kind: type[RayCaster] = RayCaster) -> RayCaster:
        """The engine's tracer, or a naive one."""
        return kind(self.mesh, self.scene.object_position)

    def arrays(self, sensed: TouchReading) -> dict[str, np.ndarray]:
        """The store of this object alone."""
        record = dict(zip(("position", "rotation"), self.sensors, strict=True)) | sensed._asdict()
        return {**store.join("touch", {self.name: record}), "empty_reading": touch.empty_reading()}


def omissions(run: Path, subjects: list[Subject], settings: Mapping) -> Iterator[Omission]:
    """Omissions for the sensors of all grasps of each object, and for the store of their readings."""
    for subject in subjects:
        touched = TouchSubject(run, subject)
        name, (position, rotation), engine = subject.name, touched.sensors, touched.tracer()
        flat = position.reshape(-1, 3), rotation.reshape(-1, 3, 3)
        for item, variant, method in (
            ("faces outside the swept box", EveryFace, "trace"),
            ("pixels after the first in range", EveryPixelForSuccess, "succeeds"),
        ):
            runs = [partial(getattr(tracer, method), *flat) for tracer in (touched.tracer(variant), touched.tracer())]
            unit = "m" if method == "trace" else "sensors"
            yield Omission("touch", item, "always", name, *runs, largest_difference, unit)

        way = np.linspace(position - FAR * rotation[..., 0], position, FRAMES), np.tile(rotation, (FRAMES, 1, 1, 1, 1))
        far = [poses[~engine.is_near(*way)] for poses in way]  # as frames have them: sensors that come near
        runs = [partial(tracer.trace, *far) for tracer in (touched.tracer(EverySensor), engine)]
        yield Omission("touch", "sensors of frames with no face near", "always", name, *runs, largest_difference, "m")

        def stored_bytes(sensed: TouchReading, touched: TouchSubject = touched) -> int:
            return folder_bytes(write_store(touched.arrays(sensed)))

        runs = [partial(sense, engine, *touched.sensors) for sense in (sense_every_reading, touch.sense)]
        how = {"difference": reading_difference, "unit": "grey levels", "size": stored_bytes}
        yield Omission("touch", "readings of sensors that touched nothing", UNTOUCHED, name, *runs, **how)
        arrays = touched.arrays(touch.sense(engine, *touched.sensors))
        runs = [partial(write, arrays) for write in (write_store_with_empty_chunks, write_store)]
        when = f"all of a chunk is the array's fill value: {UNTOUCHED}"
        yield Omission("store", "empty chunks", when, name, *runs, store_difference, "numbers", size=folder_bytes)


def write_store(arrays: Mapping[str, np.ndarray]) -> tempfile.TemporaryDirectory:
    """A temporary folder with a touch store of these arrays, deleted with the returned object."""
    folder = tempfile.TemporaryDirectory()
    store.write(Path(folder.name) / "touch.zarr", "touch", arrays, ATTRIBUTES)
    return folder


def write_store_with_empty_chunks(arrays: Mapping[str, np.ndarray]) -> tempfile.TemporaryDirectory:
    """As `write_store`, with the chunks that hold fill values only."""
    with zarr.config.set({"array.write_empty_chunks": True}):
        return write_store(arrays)


def folder_bytes(folder: tempfile.TemporaryDirectory) -> int:
    """Bytes of all files in a folder."""
    return sum(file.stat().st_size for file in Path(folder.name).rglob("*") if file.is_file())


def store_difference(one: tempfile.TemporaryDirectory, other: tempfile.TemporaryDirectory) -> float:
    """Number of values that differ between two touch stores, read back."""
    first, second = (store.read(Path(folder.name) / "touch.zarr") for folder in (one, other))
    return float(sum((first[name] != second[name]).sum() for name in first))


def largest_difference(one: np.ndarray, other: np.ndarray) -> float:
    """Largest difference of depth maps (m; infinite if only one is in range at a pixel), or 1 of two bool arrays."""
    same = one == other  # also where both are infinite
    return float(np.abs(np.where(same, 0, one) - np.where(same, 0, other)).max())


def reading_difference(one: TouchReading, other: TouchReading) -> float:
    """Largest difference of readings, grey levels; an omitted one counts as `empty_reading`."""
    return float(np.abs(_complete(one).astype(int) - _complete(other).astype(int)).max())


def _complete(sensed: TouchReading) -> np.ndarray:
    """Readings (..., 100, 100, 3), with `empty_reading` where a sensor touches nothing and none is written."""
    missing = ~sensed.success & ~sensed.reading.any(axis=(-3, -2, -1))
    return np.where(missing[..., None, None, None], touch.empty_reading(), sensed.reading)
