"""Touch and its stores: the same with each part put back in."""

import numpy as np
import pytest

from palpate import touch
from palpate.scene import SCENES
from studies.omitted import touch as left_out
from tests.studies.omitted.small_run import SETTINGS


@pytest.fixture(scope="module")
def found(run):
    folder, subject = run
    return {(each.stage, each.item): each for each in left_out.leavings(folder, [subject], SETTINGS)}


PARTS = [(scene, part) for scene in ("touch", "store") for part in SCENES[scene]]


def test_every_part_has_a_leaving(found):
    assert set(found) == set(PARTS)


@pytest.mark.parametrize("key", PARTS, ids=" ".join)
def test_the_result_is_the_same_bit_by_bit(found, key):
    leaving = found[key]
    one, other = leaving.with_it(), leaving.without()
    assert leaving.left_out and leaving.bound == 0
    assert leaving.difference(one, other) == 0
    if key in (("store", "empty chunks"), ("touch", "readings of sensors that touched nothing")):
        assert leaving.size(one) > leaving.size(other) > 10_000


def test_some_sensors_touch_and_some_don_t(run):
    folder, subject = run
    sensed = left_out.Sensed(folder, subject, "embree")
    felt = touch.sense(sensed.tracer(), *sensed.sensors)
    assert felt.success.any() and not felt.success.all()
    assert not felt.reading[~felt.success].any()
    every = touch.sense(sensed.tracer("readings of sensors that touched nothing"), *sensed.sensors)
    np.testing.assert_array_equal(every.success, felt.success)
    for reading in every.reading[~felt.success]:
        np.testing.assert_array_equal(reading, touch.empty_reading())


def test_with_every_part_in_at_once_nothing_changes(run):
    folder, subject = run
    for method in left_out.TRACERS:
        sensed = left_out.Sensed(folder, subject, method)
        everything = touch.sense(sensed.tracer(*SCENES["touch"]), *sensed.sensors)
        default = touch.sense(sensed.tracer(), *sensed.sensors)
        assert left_out.deeper(everything.depth, default.depth) == 0
        assert left_out.brighter(everything, default) == 0
        assert left_out.moved(everything, default) == 0


def test_differences_are_seen(run):
    folder, subject = run
    sensed = left_out.Sensed(folder, subject, "embree")
    felt = touch.sense(sensed.tracer(), *sensed.sensors)
    sensor = np.flatnonzero(felt.success)[0]
    row, column = np.argwhere(np.isfinite(felt.depth[sensor]))[0]
    depth, reading = felt.depth.copy(), felt.reading.copy()
    depth[sensor, row, column] = np.inf
    assert left_out.deeper(felt.depth, depth) == np.inf
    depth[sensor, row, column] = felt.depth[sensor, row, column] + np.float32(0.5)
    assert left_out.deeper(felt.depth, depth) == pytest.approx(0.5)
    reading[sensor, row, column] = 0
    darker = felt.reading[sensor, row, column].max()
    assert left_out.brighter(felt, felt._replace(reading=reading)) == darker > 0
    assert left_out.moved(felt, felt._replace(point_count=felt.point_count + 1)) == np.inf
    assert left_out.moved(felt, felt._replace(points=felt.points + 1)) == pytest.approx(1)
    assert left_out.differing(felt.success, ~felt.success) == len(felt.success)
    arrays = sensed.arrays(felt)
    changed = arrays | {"success": ~arrays["success"]}
    assert left_out.changed(left_out.written(arrays), left_out.written(changed)) == felt.success.size
