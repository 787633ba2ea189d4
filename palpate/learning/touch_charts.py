"""Touch charts from readings, by the U-Net: what it is trained on, its loss, its depths, and charts fitted to them."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from palpate.charts import fit_direct, one_sided_distance
from palpate.charts.atlas import TOUCH_VERTICES
from palpate.dataset import Dataset
from palpate.learning.data import ExperimentDataError
from palpate.models import TouchDepth
from palpate.models.losses import subsample
from palpate.protocol import CHAMFER_SCALE
from palpate.sensor import DIGIT, Sensor, Size, pixel_centres

READ_BATCH = 16  # objects whose untouched readings are in memory at a time
PREDICTION_BATCH = 16  # readings: the U-Net's memory grows with their number
# Squared difference of a pixel to the untouched reading, summed over colours in [0, 1], above which it counts
# as touched (supplement, "Optimization Details" of local touch charts).
TOUCHED = 0.001


@dataclass(frozen=True, eq=False)
class TouchReadings:
    """k successful touches of one split: reading (k, 3, r, c) uint8; depth (k, r, c) float32 m, +inf where nothing is
    in range; empty (3, r, c) uint8, an untouched sensor's reading; the sensor that they are of."""

    reading: Tensor
    depth: Tensor
    empty: Tensor
    sensor: Sensor = DIGIT

    def __len__(self) -> int:
        return len(self.reading)

    def to(self, device: torch.device) -> "TouchReadings":
        return TouchReadings(self.reading.to(device), self.depth.to(device), self.empty.to(device), self.sensor)


def read_touches(dataset: Dataset, *splits: str) -> TouchReadings:
    """The successful touches of some splits whose reading differs from the empty one anywhere. dataset: of stage
    `touch`. Raises ExperimentDataError if there are none, StoreError for a bad store."""
    chosen = dataset.select(record.name for record in dataset if record.split in splits)
    readings, depths = [], []
    for first in range(0, len(chosen), READ_BATCH):
        batch = chosen[first : first + READ_BATCH]
        success = batch.load("touch", "success")
        readings.append(batch.load("touch", "reading")[success])
        depths.append(batch.load("touch", "depth")[success])
    if not sum(map(len, readings)):
        nothing = f"no object of {' or '.join(splits)} was touched"
        raise ExperimentDataError(f"{dataset!r}: {nothing}: more objects are needed")
    reading, depth = channels_first(np.concatenate(readings)), torch.from_numpy(np.concatenate(depths))
    empty = channels_first(chosen.empty_reading)
    untouched = empty.float() / 255
    shown = torch.cat([touched(part.float() / 255, untouched).any(dim=(1, 2)) for part in reading.split(256)])
    return TouchReadings(reading[shown], depth[shown], empty, chosen.sensor)


def touched(reading: Tensor, empty: Tensor) -> Tensor:
    """Which pixels (..., r, c) of readings (..., 3, r, c) in [0, 1] differ from the empty one (3, r, c)."""
    return (reading - empty).square().sum(dim=-3) > TOUCHED


def masked_clouds(depth: Tensor, mask: Tensor, size: Size) -> list[Tensor]:
    """The points (n_i, 3) m of each depth map (k, r, c) where its mask (k, r, c) is true, in the frame of its sensor: y
    along columns, z along rows."""
    centres = [torch.from_numpy(line).to(depth) for line in map(pixel_centres, depth.shape[-2:], size)]
    z, y = torch.meshgrid(*centres, indexing="ij")
    points = torch.stack([depth, y.expand_as(depth), z.expand_as(depth)], dim=-1)
    return [cloud[pixels] for cloud, pixels in zip(points, mask, strict=True)]


def touch_depth_loss(
    predicted: Tensor, valid: Tensor, depth: Tensor, n: int | None, generator: torch.Generator, size: Size = DIGIT.size
) -> Tensor:
    """Chamfer distance (B,) between the predicted and the true local cloud of each touch (paper, section 3.2).
    predicted, depth: (B, r, c) m from the sensor plane, true depth +inf where nothing is in range. valid: (B, r, c)
    bool, the pixels whose prediction counts. n: points of either cloud that look for the nearest in the other; None:
    all. Raises ValueError if a touch has no valid pixel or nothing in range."""
    in_range = torch.isfinite(depth)
    for what, pixels in (("valid pixel", valid), ("pixel in range", in_range)):
        without = ~pixels.flatten(1).any(dim=1)
        if without.any():
            raise ValueError(f"touch {int(without.nonzero()[0])} of the batch has no {what}: leave it out")
    clouds = masked_clouds(predicted.to(depth.dtype), valid, size)
    truths = masked_clouds(depth, in_range, size)
    there = one_sided_distance([subsample(cloud, n, generator) for cloud in clouds], truths)
    back = one_sided_distance([subsample(truth, n, generator) for truth in truths], clouds)
    return CHAMFER_SCALE * (there + back)


def channels_first(images: np.ndarray) -> Tensor:
    """(..., r, c, 3) to (..., 3, r, c)."""
    return torch.from_numpy(np.ascontiguousarray(np.moveaxis(images, -1, -3)))


def touch_charts(
    model: TouchDepth,
    reading: np.ndarray,
    empty: np.ndarray,
    success: np.ndarray,
    position: np.ndarray,
    rotation: np.ndarray,
) -> np.ndarray:
    """Touch charts (..., 81, 3) float32 of sensors, from their readings; m, world frame; without success at the sensor.
    model: in evaluation mode, on any device. reading: (..., r, c, 3) uint8, empty: (r, c, 3) uint8. success: (...)
    bool. position: (..., 3) m, rotation: (..., 3, 3), world frame. The same sensors together give the same charts."""
    charts = np.repeat(position[..., None, :].astype(np.float32), TOUCH_VERTICES, axis=-2)
    sensors = np.argwhere(success)
    for part in np.array_split(sensors, -(-len(sensors) // PREDICTION_BATCH)) if len(sensors) else []:
        chosen = tuple(part.T)
        depth, valid = predict_depth(model, reading[chosen], empty)
        at, turned = (torch.from_numpy(array[chosen]).float() for array in (position, rotation))
        charts[chosen] = fit_direct(depth.cpu(), valid.cpu(), at, turned, model.sensor.size).numpy()
    return charts


@torch.inference_mode()
def predict_depth(model: TouchDepth, reading: np.ndarray, empty: np.ndarray) -> tuple[Tensor, Tensor]:
    """Depth (k, r, c) m, and pixels in contact (k, r, c) bool, of readings (k, r, c, 3) uint8, on the model's device.
    empty: (r, c, 3) uint8. Of a reading that hardly differs from it, only the pixel that differs most is in contact."""
    device = next(model.parameters()).device
    images, untouched = (channels_first(each).to(device).float() / 255 for each in (reading, empty))
    valid = touched(images, untouched)
    faint = ~valid.flatten(1).any(dim=1)
    if faint.any():
        most = (images[faint] - untouched).square().sum(dim=1).flatten(1).argmax(dim=1)
        valid.flatten(1)[faint.nonzero()[:, 0], most] = True
    return model(images).float(), valid
