"""Touches: which are learnt from, whether the U-Net learns, and the charts that it leads to."""

import csv
from dataclasses import replace

import numpy as np
import pytest
import torch

from palpate import Dataset, store
from palpate.learning.data import ExperimentDataError
from palpate.learning.learners import TouchDepthLearner
from palpate.learning.loop import train
from palpate.learning.machine import Machine
from palpate.learning.recipes import TouchDepthSettings
from palpate.learning.touch_charts import (
    masked_clouds,
    predict_depth,
    read_touches,
    touch_charts,
    touch_depth_loss,
    touched,
)
from palpate.models import TouchDepth
from palpate.sensor import DIGIT
from palpate.touch import SENSOR_RANGE, empty_reading, local_points, shade
from palpate.touch.reading import PIXEL_CENTRES
from tests.learning.test_data import ATTRIBUTES

Y, Z = np.meshgrid(PIXEL_CENTRES, PIXEL_CENTRES)
SETTINGS = TouchDepthSettings(
    width=2,
    rate=3e-3,
    schedule="one_cycle",
    clip=1.0,
    batch=2,
    steps=12,
    epochs=None,
    evaluate_every=4,
    patience=None,
    loss_points=200,
    validation_samples=2,
)


def bump(y, z, radius=0.006):
    """Depth of a ball that presses into the gel at (y, z)."""
    square = radius**2 - (Y - y) ** 2 - (Z - z) ** 2
    depth = 0.02 + radius - np.sqrt(np.maximum(square, 0))
    return np.where((square > 0) & (depth <= SENSOR_RANGE), depth, np.inf).astype(np.float32)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run of two batches, an object each, two grasps. The third sensor of each touches nothing; the first
    of the very first only grazes: in range, but its reading shows nothing."""
    folder = tmp_path_factory.mktemp("run")
    random = np.random.default_rng(0)
    for number in range(2):
        depth = np.stack([bump(*random.uniform(-0.003, 0.003, 2)) for _ in range(8)]).reshape(2, 4, 100, 100)
        depth[:, 2] = np.inf
        success = np.isfinite(depth).any(axis=(2, 3))
        reading = np.stack([shade(d) for d in depth.reshape(-1, 100, 100)]).reshape(2, 4, 100, 100, 3)
        reading[~success] = 0
        if number == 0:
            reading[0, 0] = empty_reading()
        position = random.uniform(-0.1, 0.1, (2, 4, 3))
        rotation = np.linalg.qr(random.standard_normal((2, 4, 3, 3)))[0]
        rotation *= np.sign(np.linalg.det(rotation))[..., None, None]
        points = np.zeros((2, 4, 10000, 3), np.float32)
        sensed = {
            "success": success,
            "position": position,
            "rotation": rotation,
            "depth": depth,
            "reading": reading,
            "points": points,
            "point_count": np.isfinite(depth).sum(axis=(2, 3), dtype=np.int32),
        }
        arrays = {name: values[None] for name, values in sensed.items()}
        arrays |= {"object": np.array([f"o-{number}"]), "empty_reading": empty_reading()}
        store.write(folder / f"touch/batch-000{number}.zarr", "touch", arrays, ATTRIBUTES)
    rows = [["o-0", "o", "train", "batch-0000"], ["o-1", "o", "validation", "batch-0001"]]
    with open(folder / "catalogue.csv", "w", newline="") as file:
        csv.writer(file).writerows([["object", "class", "split", "batch"], *rows])
    return folder


def touches(run, *splits):
    return read_touches(Dataset(run, ["touch"]), *splits)


def test_successful_touches_of_the_split_that_show_something(run):
    found = touches(run, "train")
    assert len(found) == 5  # 8, less two that touch nothing, less one whose reading is the empty one
    arrays = store.read(run / "touch/batch-0000.zarr")
    np.testing.assert_array_equal(found.depth[0], arrays["depth"][0, 0, 1])
    np.testing.assert_array_equal(found.reading[0].permute(1, 2, 0), arrays["reading"][0, 0, 1])
    np.testing.assert_array_equal(found.empty.permute(1, 2, 0), empty_reading())
    assert len(touches(run, "train", "validation")) == 11
    with pytest.raises(ExperimentDataError, match="no object of test was touched"):
        touches(run, "test")


def test_a_part_of_the_touches_is_made_by_replace(run):
    every = touches(run, "train")
    some = replace(every, reading=every.reading[:1], depth=every.depth[:1])
    assert len(some) == 1 and torch.equal(some.empty, every.empty) and some.sensor is every.sensor


def test_the_unet_learns_depth(run, tmp_path):
    learner = TouchDepthLearner(touches(run, "train"), touches(run, "validation"), SETTINGS, 0)
    train(learner, tmp_path / "model", tmp_path / "checkpoints", Machine("cpu"), "test")
    rows = np.genfromtxt(tmp_path / "model/history.csv", delimiter=",", names=True)
    assert rows["train_loss"][-1] < 0.8 * rows["train_loss"][0]
    again = TouchDepthLearner(touches(run, "train"), touches(run, "validation"), SETTINGS, 0)
    said = train(again, tmp_path / "again", tmp_path / "checkpoints", Machine("cpu"), "test")
    assert said["validation_loss"] == rows["validation_loss"].min()
    assert (tmp_path / "again/best.ckpt").read_bytes() == (tmp_path / "model/best.ckpt").read_bytes()


class Truth(TouchDepth):
    """A U-Net that is right: it knows the depth of each reading."""

    def __init__(self, reading, depth):
        super().__init__(1)
        self.known = {r.tobytes(): d for r, d in zip(reading, depth, strict=True)}

    def forward(self, reading):
        pixels = (reading * 255).round().byte().permute(0, 2, 3, 1).contiguous().numpy()
        return torch.stack([torch.from_numpy(self.known[p.tobytes()]) for p in pixels])


def test_charts_lie_on_the_true_local_surface(run):
    arrays = store.read(run / "touch/batch-0001.zarr")
    flat = {
        name: arrays[name].reshape(-1, *arrays[name].shape[3:])
        for name in arrays
        if arrays[name].ndim > 1 and name != "empty_reading"
    }
    # Sensors that were not touched must not be asked for.
    model = Truth(flat["reading"][flat["success"]], np.nan_to_num(flat["depth"][flat["success"]], posinf=SENSOR_RANGE))
    used = slice(0, 3)
    charts = touch_charts(
        model,
        *(flat["reading"][used], arrays["empty_reading"], flat["success"][used]),
        *(flat["position"][used], flat["rotation"][used]),
    )
    assert charts.shape == (3, 81, 3) and charts.dtype == np.float32
    for chart, success, depth, position, rotation in zip(
        charts, *(flat[name] for name in ("success", "depth", "position", "rotation")), strict=False
    ):
        if success:
            cloud = local_points(depth, position, rotation)
            off = np.linalg.norm(chart[:, None] - cloud[None], axis=2).min(axis=1)
            assert np.sqrt((off**2).mean()) < 5e-4  # m
        else:
            np.testing.assert_array_equal(chart, np.repeat(position[None].astype(np.float32), 81, axis=0))
    assert not flat["success"][used].all()


def test_a_faint_touch_has_the_pixel_that_differs_most():
    empty = np.full((100, 100, 3), 100, np.uint8)
    reading = np.stack([empty, empty])
    reading[0, 30, 70] += 2
    reading[1, 10:20, 10:20] += 60
    _, valid = predict_depth(TouchDepth(1).eval(), reading, empty)
    assert valid[0].nonzero().tolist() == [[30, 70]]
    assert valid[1].sum() == 100 and valid[1, 10:20, 10:20].all()


def all_pairs(a, b):
    """9000 times the mean squared distance from each of a to the nearest of b."""
    return 9000 * ((a[:, None] - b[None]) ** 2).sum(axis=2).min(axis=1).mean()


def test_touched_is_the_supplements_threshold():
    empty = torch.full((3, 2, 2), 0.5)
    reading = empty.clone()[None]
    reading[0, :, 0, 0] += 0.0184  # 3 x 0.0184^2 = 0.00102
    reading[0, :, 0, 1] += 0.0182  # 0.00099
    reading[0, 1, 1, 0] -= 0.0317  # 0.001005
    assert touched(reading, empty).tolist() == [[[True, False], [True, False]]]


def test_the_sheet_has_columns_along_y_and_rows_along_z():
    depth = torch.rand(100, 100, dtype=torch.float64)
    (points,) = masked_clouds(depth[None], torch.ones(1, 100, 100, dtype=torch.bool), DIGIT.size)
    points = points.unflatten(0, (100, 100))
    for row, column in [(0, 0), (3, 97), (99, 12)]:
        expected = [float(depth[row, column]), PIXEL_CENTRES[column], PIXEL_CENTRES[row]]
        np.testing.assert_allclose(points[row, column], expected, rtol=1e-12)


def test_touch_depth_against_all_pairs():
    random = np.random.default_rng(0)
    y, z = np.meshgrid(PIXEL_CENTRES, PIXEL_CENTRES)
    depth = 0.02 + 0.1 * y + np.where(np.hypot(y, z) < 0.002, 0, np.inf)
    predicted = 0.02 + 0.002 * random.standard_normal((100, 100))
    valid = np.hypot(y, z - 0.001) < 0.002
    a = np.stack([predicted, y, z], 2)[valid]
    b = np.stack([depth, y, z], 2)[np.isfinite(depth)]
    tensors = [torch.from_numpy(array)[None] for array in (predicted, valid, depth)]
    tensors[0].requires_grad_()
    losses = touch_depth_loss(*tensors, None, torch.Generator())
    losses.sum().backward()
    found = float(losses.detach())
    assert found == pytest.approx(all_pairs(a, b) + all_pairs(b, a), rel=1e-9)
    assert not tensors[0].grad[0][~torch.from_numpy(valid)].any()
    # A step against the gradient lowers it.
    with torch.no_grad():
        lower = touch_depth_loss(tensors[0] - 1e-6 * tensors[0].grad, *tensors[1:], None, torch.Generator())
    assert float(lower) < found
    sampled = [
        float(touch_depth_loss(tensors[0].detach(), *tensors[1:], 100, torch.Generator().manual_seed(k)))
        for k in range(40)
    ]
    assert np.mean(sampled) == pytest.approx(found, rel=0.1)
