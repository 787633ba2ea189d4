"""Touch and its stores: the same by the engine and by each naive variant."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from palpate import touch
from palpate.store import Store
from studies.omitted import touch as omitted
from studies.omitted.omission import OMITTED
from tests.studies.omitted.small_run import SETTINGS

ITEMS = [
    ("touch", "faces outside the swept box"),
    ("touch", "pixels after the first in range"),
    ("touch", "sensors of frames with no face near"),
    ("touch", "readings of sensors that touched nothing"),
    ("store", "empty chunks"),
]
SMALLER = (("store", "empty chunks"), ("touch", "readings of sensors that touched nothing"))


@pytest.fixture(scope="module")
def found(run):
    folder, subject = run
    return {(each.stage, each.item): each for each in omitted.omissions(folder, [subject], SETTINGS)}


def test_every_item_is_compared(found):
    assert list(found) == ITEMS


@pytest.mark.parametrize("key", ITEMS, ids=" ".join)
def test_the_result_is_the_same_bit_by_bit(found, key):
    row = found[key]
    one, other = row.with_it(), row.without()
    assert row.state == OMITTED and row.bound == 0
    assert row.difference(one, other) == 0
    if key in SMALLER:
        assert row.size(one) > row.size(other) > 10_000


def test_some_sensors_touch_and_some_don_t(run):
    folder, subject = run
    touched = omitted.TouchSubject(folder, subject)
    sensed = touch.sense_scene(touched.scene)
    assert sensed.success.shape == touched.scene.sensor_position.shape[:2] == (2, 4)
    assert sensed.success.any() and not sensed.success.all()
    assert not sensed.reading[~sensed.success].any()
    every = omitted.sense_every_reading(touched.tracer(), *touched.sensors)
    np.testing.assert_array_equal(every.success, sensed.success)
    for reading in every.reading[~sensed.success]:
        np.testing.assert_array_equal(reading, touch.empty_reading())


def test_with_everything_in_at_once_nothing_changes(run):
    folder, subject = run
    touched = omitted.TouchSubject(folder, subject)
    variants = omitted.EveryFace, omitted.EverySensor, omitted.EveryPixelForSuccess
    tracer = touched.tracer(type("Naive", variants, {}))
    everything = omitted.sense_every_reading(tracer, *touched.sensors)
    default = touch.sense_scene(touched.scene, touch.scene_tracer(touched.scene))
    assert omitted.largest_difference(everything.depth, default.depth) == 0
    assert omitted.reading_difference(everything, default) == 0


def test_differences_are_seen(run):
    folder, subject = run
    touched = omitted.TouchSubject(folder, subject)
    sensed = touch.sense_scene(touched.scene)
    pixel = tuple(np.argwhere(np.isfinite(sensed.depth))[0])
    depth, reading = sensed.depth.copy(), sensed.reading.copy()
    depth[pixel] = np.inf
    assert omitted.largest_difference(sensed.depth, depth) == np.inf
    depth[pixel] = sensed.depth[pixel] + np.float32(0.5)
    assert omitted.largest_difference(sensed.depth, depth) == pytest.approx(0.5)
    reading[pixel] = 0
    assert omitted.reading_difference(sensed, sensed._replace(reading=reading)) == sensed.reading[pixel].max() > 0
    assert omitted.largest_difference(sensed.success, ~sensed.success) == 1
    arrays = touched.arrays(sensed)
    changed = arrays | {"success": ~arrays["success"]}
    assert omitted.store_difference(omitted.write_store(arrays), omitted.write_store(changed)) == sensed.success.size


def sensors():
    """One before a rod's side, one before its edge, and one far away; x points at the rod."""
    rotation = np.tile(np.diag([-1.0, 1.0, -1.0]), (3, 1, 1))
    return np.array([[0.04, 0, 0], [0.04, 0.024, 0.1], [0.3, 0, 0]]), rotation


class Counting(touch.RayCaster):
    """Counts the pixels that are traced."""

    pixels = 0

    def _embree_depth(self, origin, rotation, plane):
        depth, doubtful = super()._embree_depth(origin, rotation, plane)
        self.pixels += depth.size
        return depth, doubtful


def counted(*variants):
    rod = trimesh.creation.box((0.04, 0.04, 0.45)).subdivide()
    return type("Variant", (*variants, Counting), {})(rod)


def test_only_sensors_with_a_face_near_are_traced():
    engine, naive = counted(), counted(omitted.EverySensor)
    depth = engine.trace(*sensors())
    np.testing.assert_array_equal(depth, naive.trace(*sensors()))
    assert naive.pixels == 3 * touch.RESOLUTION**2
    finite = np.isfinite(depth).sum(axis=(1, 2))
    assert finite[0] == touch.RESOLUTION**2 and 0 < finite[1] < touch.RESOLUTION**2 and finite[2] == 0
    assert engine.pixels == 2 * touch.RESOLUTION**2


def test_success_takes_fewer_pixels_than_depth():
    engine, naive, traced = counted(), counted(omitted.EveryPixelForSuccess), counted()
    assert engine.succeeds(*sensors()).tolist() == naive.succeeds(*sensors()).tolist() == [True, True, False]
    traced.trace(*sensors())
    assert naive.pixels == traced.pixels and engine.pixels < naive.pixels / 50


def test_empty_chunks_are_on_disk_only_in_the_naive_store():
    arrays = {
        "object": np.array(["a"]),
        "success": np.zeros((1, 1, 4), dtype=bool),
        "position": np.zeros((1, 1, 4, 3)),
        "rotation": np.zeros((1, 1, 4, 3, 3)),
        "depth": np.full((1, 1, 4, 5, 5), np.inf, dtype=np.float32),
        "reading": np.zeros((1, 1, 4, 5, 5, 3), dtype=np.uint8),
        "points": np.zeros((1, 1, 4, 25, 3), dtype=np.float32),
        "point_count": np.zeros((1, 1, 4), dtype=np.int32),
        "empty_reading": np.ones((5, 5, 3), dtype=np.uint8),
    }
    less = omitted.write_store(arrays)
    files = []
    for folder in (less, omitted.write_store_with_empty_chunks(arrays)):
        path = Path(folder.name) / "touch.zarr"
        files.append({str(file.relative_to(path)) for file in path.rglob("c/**/*") if file.is_file()})
        for key, array in arrays.items():
            np.testing.assert_array_equal(Store(path)[key], array)
    empty = {"success", "position", "rotation", "depth", "reading", "points", "point_count"}
    assert {file.split("/")[0] for file in files[1] - files[0]} == empty
    assert {file.split("/")[0] for file in files[0]} == {"object", "empty_reading"}
