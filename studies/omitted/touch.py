"""Omissions of touch and its store: naive variants of the engine, and comparisons with it."""

import tempfile
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path

import numpy as np
import zarr

from palpate import store, touch
from palpate.mesh import load_visual
from palpate.sensor import DIGIT
from palpate.touch import TouchReading, Tracer
from palpate.touch.tracing import Block
from studies.omitted.omission import Omission
from studies.scenes import scene_of
from studies.subjects import Subject

ATTRIBUTES = {"made_from": {}, "seed": 0, "sensor": DIGIT.description()}
ALWAYS, UNTOUCHED = "always", "a sensor touches nothing"


class EveryFace(Tracer):
    """Traces faces outside the swept box, too."""

    def _near_faces(self, origin, rotation) -> np.ndarray:
        return np.arange(len(self._mesh.triangles))


class EveryPixel(Tracer):
    """Traces pixels with no face in front of them, too."""

    def _block_in_reach(self, origin, rotation) -> Block:
        return Block(slice(0, touch.RESOLUTION), slice(0, touch.RESOLUTION))


class EveryPixelForSuccess(Tracer):
    """Continues after the first pixel in range, where only success is needed."""

    def _passes(self, block: Block) -> list[Block]:
        return [block]


def naive(tracer: type[Tracer], *variants: type[Tracer]) -> type[Tracer]:
    """A tracer class combined with variants of this module."""
    return type("NaiveTracer", (*variants, tracer), {})


def sense_every_reading(tracer: Tracer, *sensors: np.ndarray) -> TouchReading:
    """As `touch.sense`, with the readings of sensors that touch nothing."""
    sensed = touch.sense(tracer, *sensors)
    for sensor in zip(*np.nonzero(~sensed.success), strict=True):
        sensed.reading[sensor] = touch.shade(sensed.depth[sensor])
    return sensed


def sense_every_cloud(tracer: Tracer, position: np.ndarray, rotation: np.ndarray) -> TouchReading:
    """As `touch.sense`, with the points of sensors that touch nothing: there are none."""
    sensed = touch.sense(tracer, position, rotation)
    for sensor in zip(*np.nonzero(~sensed.success), strict=True):
        cloud = touch.local_points(sensed.depth[sensor], position[sensor], rotation[sensor])
        sensed.points[sensor][: len(cloud)] = cloud
        sensed.point_count[sensor] = len(cloud)
    return sensed


class TouchSubject:
    """The sensors of all grasps of an object, and tracers of its mesh."""

    def __init__(self, run: Path, subject: Subject, method: str):
        self.name, self.method = subject.name, touch.TRACERS[method]
        self.scene, self.mesh = scene_of(run, subject), load_visual(subject.folder)
        self.sensors = self.scene.sensor_position, self.scene.sensor_rotation

    def tracer(self, *variants: type[Tracer]) -> Tracer:
        """The engine's tracer, or with variants a naive one."""
        return naive(self.method, *variants)(self.mesh, self.scene.object_position)

    def arrays(self, sensed: TouchReading) -> dict[str, np.ndarray]:
        """The store of this object alone."""
        record = dict(zip(("position", "rotation"), self.sensors, strict=True)) | sensed._asdict()
        return {**store.join("touch", {self.name: record}), "empty_reading": touch.empty_reading()}


def omissions(run: Path, subjects: list[Subject], settings: Mapping) -> Iterator[Omission]:
    """Omissions for the sensors of all grasps of each object, and for the store of their readings."""
    for subject in subjects:
        touched = TouchSubject(run, subject, settings["touch"]["method"])
        name, (position, rotation), engine = subject.name, touched.sensors, touched.tracer()
        flat = position.reshape(-1, 3), rotation.reshape(-1, 3, 3)
        for item, variant, method, difference, unit in (
            ("faces outside the swept box", EveryFace, "trace", depth_difference, "m"),
            ("pixels outside the block in reach", EveryPixel, "trace", depth_difference, "m"),
            ("pixels after the first in range", EveryPixelForSuccess, "succeeds", count_differing, "sensors"),
        ):
            runs = [partial(getattr(each, method), *flat) for each in (touched.tracer(variant), touched.tracer())]
            yield Omission("touch", item, ALWAYS, name, *runs, difference, unit)

        def stored_bytes(sensed: TouchReading, touched: TouchSubject = touched) -> int:
            return folder_bytes(write_store(touched.arrays(sensed)))

        for item, variant, difference, unit in (
            ("readings of sensors that touched nothing", sense_every_reading, reading_difference, "grey levels"),
            ("points of sensors that touched nothing", sense_every_cloud, cloud_difference, "m"),
        ):
            runs = [partial(each, engine, *touched.sensors) for each in (variant, touch.sense)]
            yield Omission("touch", item, UNTOUCHED, name, *runs, difference, unit, size=stored_bytes)
        arrays = touched.arrays(touch.sense(engine, *touched.sensors))
        runs = [partial(each, arrays) for each in (write_store_with_empty_chunks, write_store)]
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


def depth_difference(one: np.ndarray, other: np.ndarray) -> float:
    """Largest difference (m) of depth maps (k, rows, columns); infinite if only one is in range at a pixel."""
    same = one == other  # also where both are infinite
    return float(np.abs(np.where(same, 0, one) - np.where(same, 0, other)).max())


def count_differing(one: np.ndarray, other: np.ndarray) -> float:
    """Number of differing values of two (k,) bool arrays."""
    return float((one != other).sum())


def reading_difference(one: TouchReading, other: TouchReading) -> float:
    """Largest difference of readings, grey levels; an omitted one counts as `empty_reading`."""
    return float(np.abs(_complete(one).astype(int) - _complete(other).astype(int)).max())


def _complete(sensed: TouchReading) -> np.ndarray:
    """Readings (..., 100, 100, 3), with `empty_reading` where a sensor touches nothing and none is written."""
    missing = ~sensed.success & ~sensed.reading.any(axis=(-3, -2, -1))
    return np.where(missing[..., None, None, None], touch.empty_reading(), sensed.reading)


def cloud_difference(one: TouchReading, other: TouchReading) -> float:
    """Largest difference (m) of local point clouds; infinite if their numbers of points differ."""
    if not np.array_equal(one.point_count, other.point_count):
        return np.inf
    return float(np.abs(one.points - other.points).max())
