"""Plans of the data stages reach the engines that are built from them."""

import numpy as np
import pytest
import trimesh

from palpate import store
from palpate.scene import plan
from palpate.store.files import Store
from palpate.touch import RESOLUTION, SENSOR_RANGE, SENSOR_WIDTH, RayCaster, SphereTracer

TOUCH = plan("touch")


def rod():
    return trimesh.creation.box((0.04, 0.04, 0.45)).subdivide()


def sensors():
    """One before the rod's side, one before its edge, and one far away; x points at the rod."""
    rotation = np.tile(np.diag([-1.0, 1.0, -1.0]), (3, 1, 1))
    return np.array([[0.04, 0, 0], [0.04, 0.024, 0.1], [0.3, 0, 0]]), rotation


class Recording(RayCaster):
    """Counts the pixels that are traced."""

    pixels = 0

    def _depth(self, origin, rotation, block):
        depth = super()._depth(origin, rotation, block)
        self.pixels += depth.size
        return depth


def traced(*parts):
    tracer = Recording(rod(), plan=TOUCH.including(*parts) if parts else TOUCH)
    return tracer.trace(*sensors()), tracer.pixels


def test_pixels_outside_the_felt_block_are_not_traced_unless_put_in():
    depth, pixels = traced()
    every, all_pixels = traced("pixels outside the felt block")
    assert all_pixels == 3 * RESOLUTION**2
    finite = np.isfinite(depth).sum(axis=(1, 2))
    assert finite[0] == RESOLUTION**2 and 0 < finite[1] < RESOLUTION**2 and finite[2] == 0
    assert finite.sum() <= pixels < 2 * RESOLUTION**2
    np.testing.assert_array_equal(depth, every)


def test_success_takes_fewer_pixels_than_depth_unless_they_are_put_in():
    counts = {}
    for parts in ((), ("pixels after the first in range",)):
        tracer = Recording(rod(), plan=TOUCH.including(*parts) if parts else TOUCH)
        assert tracer.succeeds(*sensors()).tolist() == [True, True, False]
        counts[parts] = tracer.pixels
    few, every = counts.values()
    assert every == traced()[1] and few < every / 50


@pytest.mark.parametrize("tracer", [RayCaster, SphereTracer])
def test_felt_faces_are_those_with_a_point_before_a_sensor_and_few_others(tracer):
    solid = rod().subdivide().subdivide()
    position, rotation = sensors()
    felt = tracer(solid).felt_faces(position, rotation)
    assert felt.shape == (len(solid.faces),)
    points, face = trimesh.sample.sample_surface(solid, 200_000, seed=0)
    inside = np.zeros(len(solid.faces), dtype=bool)
    for origin, frame in zip(position, rotation, strict=True):
        x, y, z = ((points - origin) @ frame).T
        half = SENSOR_WIDTH / 2
        before = (x >= 0) & (x <= SENSOR_RANGE) & (np.abs(y) <= half) & (np.abs(z) <= half)
        inside[face[before]] = True
    assert inside.any() and felt[inside].all() and felt.sum() < 0.1 * len(felt)


def test_empty_chunks_are_not_on_disk_unless_put_in(tmp_path):
    arrays = {
        "object": np.array(["a"]),
        "success": np.zeros((1, 4), dtype=bool),
        "position": np.zeros((1, 4, 3)),
        "rotation": np.zeros((1, 4, 3, 3)),
        "depth": np.full((1, 4, 5, 5), np.inf, dtype=np.float32),
        "reading": np.zeros((1, 4, 5, 5, 3), dtype=np.uint8),
        "points": np.zeros((1, 4, 25, 3), dtype=np.float32),
        "point_count": np.zeros((1, 4), dtype=np.int32),
        "empty_reading": np.ones((5, 5, 3), dtype=np.uint8),
    }
    attributes, files = {"config_digest": "", "seed": 0}, {}
    for name, each in {"less": plan("store"), "every": plan("store").including("empty chunks")}.items():
        path = tmp_path / name / "touch.zarr"
        store.write(path, "touch", arrays, attributes, plan=each)
        files[name] = {str(file.relative_to(path)) for file in path.rglob("c/**/*") if file.is_file()}
        for key, array in arrays.items():
            np.testing.assert_array_equal(Store(path)[key], array)
    empty = {"success", "position", "rotation", "depth", "reading", "points", "point_count"}
    assert {file.split("/")[0] for file in files["every"] - files["less"]} == empty
    assert {file.split("/")[0] for file in files["less"]} == {"object", "empty_reading"}
