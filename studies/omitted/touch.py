"""What touch omits, and the stores that hold it: naive variants of the engine, and comparisons with it."""

import shutil
import tempfile
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path

import numpy as np
import zarr

from palpate import store, touch
from palpate.mesh import load_visual
from palpate.scene import Scene
from palpate.touch import TouchReading, Tracer
from palpate.touch.tracing import Block
from studies.omitted.omission import Omission
from studies.scenes import scene_of
from studies.subjects import Subject

ATTRIBUTES = {"config_digest": "", "seed": 0}
ALWAYS, UNTOUCHED = "always", "a sensor touches nothing"


class EveryFace(Tracer):
    """Looks at faces outside the swept box, too."""

    def _near_faces(self, origin, rotation) -> np.ndarray:
        return np.arange(len(self._mesh.triangles))


class EveryPixel(Tracer):
    """Looks at pixels with no face before them, too."""

    def _block_in_reach(self, origin, rotation) -> Block:
        return Block(slice(0, touch.RESOLUTION), slice(0, touch.RESOLUTION))


class EveryPixelForSuccess(Tracer):
    """Goes on after the first pixel in range, where only success is asked for."""

    def _passes(self, block: Block) -> list[Block]:
        return [block]


def naive(tracer: type[Tracer], *variants: type[Tracer]) -> type[Tracer]:
    """A tracer with some of the variants above."""
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


class Touched:
    """The sensors of all grasps of an object, and the tracers that look at it."""

    def __init__(self, run: Path, subject: Subject, method: str):
        self.name, self.method = subject.name, touch.TRACERS[method]
        self.scene: Scene = scene_of(run, subject)
        self.mesh = load_visual(subject.folder)
        self.sensors = self.scene.sensor_position, self.scene.sensor_rotation

    def tracer(self, *variants: type[Tracer]) -> Tracer:
        """The engine's, or a naive one."""
        return naive(self.method, *variants)(self.mesh, self.scene.object_position)

    def arrays(self, sensed: TouchReading) -> dict[str, np.ndarray]:
        """The store of this object alone."""
        record = dict(zip(("position", "rotation"), self.sensors, strict=True)) | sensed._asdict()
        return {**store.join("touch", {self.name: record}), "empty_reading": touch.empty_reading()}


def omissions(run: Path, subjects: list[Subject], settings: Mapping) -> Iterator[Omission]:
    """The sensors of all grasps of each object, by the engine and by naive variants, and stores of what they read.

    settings: `touch`. Read of the run: meshes and grasps.
    """
    for subject in subjects:
        touched = Touched(run, subject, settings["touch"]["method"])
        row = partial(Omission, object=touched.name)
        flat = touched.scene.sensor_position.reshape(-1, 3), touched.scene.sensor_rotation.reshape(-1, 3, 3)
        for item, variant, method, difference, unit in (
            ("faces outside the swept box", EveryFace, "trace", deeper, "m"),
            ("pixels outside the block in reach", EveryPixel, "trace", deeper, "m"),
            ("pixels after the first in range", EveryPixelForSuccess, "succeeds", differing, "sensors"),
        ):
            yield row(
                stage="touch",
                item=item,
                when=ALWAYS,
                with_it=partial(getattr(touched.tracer(variant), method), *flat),
                without=partial(getattr(touched.tracer(), method), *flat),
                difference=difference,
                unit=unit,
            )
        engine = touched.tracer()
        for item, variant, difference, unit in (
            ("readings of sensors that touched nothing", sense_every_reading, brighter, "grey levels"),
            ("points of sensors that touched nothing", sense_every_cloud, moved, "m"),
        ):
            yield row(
                stage="touch",
                item=item,
                when=UNTOUCHED,
                with_it=partial(variant, engine, *touched.sensors),
                without=partial(touch.sense, engine, *touched.sensors),
                difference=difference,
                unit=unit,
                size=lambda sensed, touched=touched: size(written(touched.arrays(sensed))),
            )
        arrays = touched.arrays(touch.sense(engine, *touched.sensors))
        yield row(
            stage="store",
            item="empty chunks",
            when=f"all of a chunk is the array's fill value: {UNTOUCHED}",
            with_it=partial(written_with_empty_chunks, arrays, written(arrays)),
            without=partial(written, arrays),
            difference=changed,
            unit="numbers",
            size=size,
        )


def written(arrays: Mapping[str, np.ndarray]) -> tempfile.TemporaryDirectory:
    """A folder with a touch store of these arrays; it is gone when the result is."""
    folder = tempfile.TemporaryDirectory()
    store.write(Path(folder.name) / "touch.zarr", "touch", arrays, ATTRIBUTES)
    return folder


def written_with_empty_chunks(
    arrays: Mapping[str, np.ndarray], model: tempfile.TemporaryDirectory
) -> tempfile.TemporaryDirectory:
    """As `written`, with the chunks that hold fill values only; model: the arrays as `written` wrote them."""
    folder = tempfile.TemporaryDirectory()
    copy = shutil.copytree(Path(model.name) / "touch.zarr", Path(folder.name) / "touch.zarr")
    with zarr.config.set({"array.write_empty_chunks": True}):
        for name, array in zarr.open_group(copy).arrays():
            if arrays[name].dtype.kind in "biuf":  # no name is empty
                array[...] = arrays[name]
    return folder


def size(folder: tempfile.TemporaryDirectory) -> int:
    """Bytes of all files in a folder."""
    return sum(file.stat().st_size for file in Path(folder.name).rglob("*") if file.is_file())


def changed(one: tempfile.TemporaryDirectory, other: tempfile.TemporaryDirectory) -> float:
    """How many numbers two touch stores don't have in common, when they are read back."""
    first, second = (store.read(Path(folder.name) / "touch.zarr") for folder in (one, other))
    return float(sum((first[name] != second[name]).sum() for name in first))


def deeper(one: np.ndarray, other: np.ndarray) -> float:
    """Metres between depth maps (k, rows, columns), infinite where only one of them is in range."""
    same = one == other  # also where both are infinite
    return float(np.abs(np.where(same, 0, one) - np.where(same, 0, other)).max())


def differing(one: np.ndarray, other: np.ndarray) -> float:
    """How many of (k,) bools differ."""
    return float((one != other).sum())


def brighter(one: TouchReading, other: TouchReading) -> float:
    """Grey levels between readings; one that is omitted is `empty_reading`."""
    return float(np.abs(_complete(one).astype(int) - _complete(other).astype(int)).max())


def _complete(sensed: TouchReading) -> np.ndarray:
    """Readings (..., 100, 100, 3), with `empty_reading` where a sensor touches nothing and none is written."""
    missing = ~sensed.success & ~sensed.reading.any(axis=(-3, -2, -1))
    return np.where(missing[..., None, None, None], touch.empty_reading(), sensed.reading)


def moved(one: TouchReading, other: TouchReading) -> float:
    """Metres between local point clouds; infinite if they have not as many points."""
    if not np.array_equal(one.point_count, other.point_count):
        return np.inf
    return float(np.abs(one.points - other.points).max())
