"""What touch leaves out, and the stores that hold it."""

import tempfile
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path

import numpy as np
import zarr

from palpate import store, touch
from palpate.mesh import OBJECT_POSITION, load_visual
from palpate.scene import plan
from palpate.touch import TouchReading
from studies.omitted.omission import Leaving
from studies.subjects import Subject

TRACERS = {"embree": touch.RayCaster, "sphere_tracing": touch.SphereTracer}
ATTRIBUTES = {"config_digest": "", "seed": 0}
ALWAYS = "always"
DEFAULT, STORE = plan("touch"), plan("store")


class Sensed:
    """The sensors of all grasps of an object, and what they read."""

    def __init__(self, run: Path, subject: Subject, method: str):
        self.name = subject.name
        self.mesh, self.tracer_of = load_visual(subject.folder), TRACERS[method]
        grasps = store.open(run / f"grasps/{subject.batch}.h5")
        row = grasps["object"].tolist().index(subject.name)
        self.position, self.rotation = grasps.get("sensor_position", row), grasps.get("sensor_rotation", row)
        self.sensors = self.position.reshape(-1, 3), self.rotation.reshape(-1, 3, 3)

    def tracer(self, *parts: str) -> touch.RayCaster | touch.SphereTracer:
        """The object, with the parts put in that the plan leaves out."""
        plan = DEFAULT.including(*parts) if parts else DEFAULT
        return self.tracer_of(self.mesh, OBJECT_POSITION, plan=plan)

    def arrays(self, felt: TouchReading) -> dict[str, np.ndarray]:
        """The store of this object alone."""
        grasps = len(self.position)
        felt = {key: array.reshape(grasps, -1, *array.shape[1:]) for key, array in felt._asdict().items()}
        record = {"position": self.position, "rotation": self.rotation, **felt}
        return {**store.join("touch", {self.name: record}), "empty_reading": touch.empty_reading()}


def leavings(run: Path, subjects: list[Subject], settings: Mapping) -> Iterator[Leaving]:
    """The sensors of all grasps of each object, with each part in and out, and a store of what they read.

    settings: `touch`. Read of the run: meshes and grasps.
    """
    for subject in subjects:
        sensed = Sensed(run, subject, settings["touch"]["method"])
        for part in ("faces outside the swept box", "pixels outside the felt block"):
            yield _traced(sensed, part, "trace", deeper, "m")
        yield _traced(sensed, "pixels after the first in range", "succeeds", differing, "sensors")
        part = "readings of sensors that touched nothing"
        yield _sensed(sensed, part, brighter, "grey levels")
        yield _sensed(sensed, "points of sensors that touched nothing", moved, "m")
        yield _written(sensed)


def _traced(sensed: Sensed, part: str, look: str, difference: Callable, unit: str) -> Leaving:
    """A part of tracing: `look` is a method of the tracer."""
    with_it, without = getattr(sensed.tracer(part), look), getattr(sensed.tracer(), look)
    return Leaving(
        scene="touch",
        part=part,
        when=ALWAYS,
        object=sensed.name,
        with_it=lambda: with_it(*sensed.sensors),
        without=lambda: without(*sensed.sensors),
        difference=difference,
        unit=unit,
        left_out=part in DEFAULT.left_out,
    )


def _sensed(sensed: Sensed, part: str, difference: Callable, unit: str) -> Leaving:
    """A part of what is made of the depth maps; its bytes are those of the store."""
    with_it, without = sensed.tracer(part), sensed.tracer()
    return Leaving(
        scene="touch",
        part=part,
        when="a sensor touches nothing",
        object=sensed.name,
        with_it=lambda: touch.sense(with_it, *sensed.sensors),
        without=lambda: touch.sense(without, *sensed.sensors),
        difference=difference,
        unit=unit,
        size=lambda felt: size(written(sensed.arrays(felt))),
        left_out=part in DEFAULT.left_out,
    )


def _written(sensed: Sensed) -> Leaving:
    """The chunks of sensors that touched nothing."""
    part = "empty chunks"
    arrays = sensed.arrays(touch.sense(sensed.tracer(), *sensed.sensors))
    return Leaving(
        scene="store",
        part=part,
        when="all of a chunk is the array's fill value: a sensor touches nothing",
        object=sensed.name,
        with_it=partial(written, arrays, every_chunk=True),
        without=partial(written, arrays),
        difference=changed,
        unit="numbers",
        size=size,
        left_out=part in STORE.left_out,
    )


def written(arrays: Mapping[str, np.ndarray], every_chunk: bool = False) -> tempfile.TemporaryDirectory:
    """A folder with a touch store of these arrays; it is gone when the result is.

    every_chunk: also those that hold nothing but the fill value.
    """
    folder = tempfile.TemporaryDirectory()
    with zarr.config.set({"array.write_empty_chunks": every_chunk}):
        store.write(Path(folder.name) / "touch.zarr", "touch", arrays, ATTRIBUTES)
    return folder


def size(folder: tempfile.TemporaryDirectory) -> int:
    """Bytes of all files in a folder."""
    return sum(file.stat().st_size for file in Path(folder.name).rglob("*") if file.is_file())


def changed(one: tempfile.TemporaryDirectory, other: tempfile.TemporaryDirectory) -> float:
    """How many numbers two touch stores don't have in common, when they are read back."""
    first, second = (store.read(Path(folder.name) / "touch.zarr") for folder in (one, other))
    return float(sum((first[name] != second[name]).sum() for name in first))


def deeper(one: np.ndarray, other: np.ndarray) -> float:
    """Metres between depth maps (k, rows, columns), infinite where one feels what the other doesn't."""
    same = one == other  # also where both are infinite
    return float(np.abs(np.where(same, 0, one) - np.where(same, 0, other)).max())


def differing(one: np.ndarray, other: np.ndarray) -> float:
    """How many of (k,) bools differ."""
    return float((one != other).sum())


def brighter(one: TouchReading, other: TouchReading) -> float:
    """Grey levels between readings; one that is left out is `empty_reading`."""
    return float(np.abs(_seen(one).astype(int) - _seen(other).astype(int)).max())


def _seen(felt: TouchReading) -> np.ndarray:
    """Readings (k, 100, 100, 3), with `empty_reading` where a sensor touches nothing and none is written."""
    missing = ~felt.success & ~felt.reading.any(axis=(1, 2, 3))
    return np.where(missing[:, None, None, None], touch.empty_reading(), felt.reading)


def moved(one: TouchReading, other: TouchReading) -> float:
    """Metres between local point clouds; infinite if they have not as many points."""
    if not np.array_equal(one.point_count, other.point_count):
        return np.inf
    return float(np.abs(one.points - other.points).max())
