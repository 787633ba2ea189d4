"""From objects' results to a batch's arrays, and back."""

import numpy as np
import pytest

from palpate.batch import Rejection, read_rejections
from palpate.seal import combine
from palpate.sensor import DIGIT
from palpate.store import Store, StoreError, join, read, write, write_batch

ATTRIBUTES = {"seed": 0, "made_from": {}, "sensor": DIGIT.description()}


def record(number: int, grasps: int) -> dict[str, np.ndarray]:
    """Arrays of one object that are all `number`, except that grasps can be told apart."""
    each = np.arange(grasps) + 10 * number
    return {
        "joint_positions": np.repeat(each[:, None], 16, axis=1),
        "palm_pose": each[:, None, None] * np.ones((4, 4)),
        "link_pose": each[:, None, None, None] * np.ones((3, 4, 4)),
        "sensor_position": each[:, None, None] * np.ones((4, 3)),
        "sensor_rotation": each[:, None, None, None] * np.ones((4, 3, 3)),
        "touches": np.ones((grasps, 4), dtype=bool),
        "penetration": each,
        "attempts": number,
        "discarded": {"not in": "the contract"},
    }


def test_arrays_of_objects_are_stacked_in_their_order():
    arrays = join("grasps", {"b": record(2, 3), "a": record(1, 3)})
    assert arrays["object"].tolist() == ["b", "a"]
    assert arrays["penetration"].tolist() == [[20, 21, 22], [10, 11, 12]]
    assert arrays["attempts"].tolist() == [2, 1]
    assert arrays["palm_pose"][1, 1, 2, 2] == 11


def test_what_is_joined_can_be_written_and_read(tmp_path):
    for objects in (0, 1, 2):
        arrays = join("grasps", {f"object-{number}": record(number, 5) for number in range(objects)})
        path = tmp_path / f"batch-{objects}.h5"
        write(path, "grasps", arrays, ATTRIBUTES)
        found = read(path)
        assert found.keys() == arrays.keys()
        for name, array in arrays.items():
            np.testing.assert_array_equal(found[name], array)
            grasps = 5 if objects else 0
            assert array.shape[:2] == ((objects,) if name in ("object", "attempts") else (objects, grasps))


def test_objects_with_different_numbers_of_grasps_are_refused_and_named():
    with pytest.raises(StoreError, match=r"joint_positions.*\(3, 16\) of b, \(2, 16\) of a"):
        join("grasps", {"b": record(2, 3), "a": record(1, 2)})


def test_a_batch_has_its_store_and_its_rejections(tmp_path):
    """In `more` are arrays of the batch; an object that was rejected is in the table only."""
    rejections = [Rejection("b", "touch", "not felt")]
    more = {"empty_reading": np.full((2, 2, 3), 7, np.uint8)}
    felt = {
        "success": np.ones((1, 4), bool),
        "position": np.zeros((1, 4, 3)),
        "rotation": np.zeros((1, 4, 3, 3)),
        "depth": np.ones((1, 4, 2, 2)),
        "reading": np.zeros((1, 4, 2, 2, 3), np.uint8),
        "points": np.zeros((1, 4, 4, 3)),
        "point_count": np.ones((1, 4), int),
    }
    sensor, made_from = DIGIT.description(), combine({"surface": {"points": 100}})
    path, table = tmp_path / "touch/batch-0000.zarr", tmp_path / "rejected/touch/batch-0000.csv"
    paths, results = {"touch": path, "rejected": table}, ({"a": felt}, rejections)
    write_batch(paths, "touch", results, 3, made_from, more, {"sensor": sensor})
    assert read_rejections([table]) == rejections
    found = Store(path)
    assert found["object"].tolist() == ["a"]
    assert (found["empty_reading"] == 7).all() and (found["depth"] == 1).all()
    assert found.attributes["seed"] == 3 and found.attributes["sensor"] == sensor
    assert found.seal.config == {"surface.points": 100}
