"""Successful touches: the U-Net's training data, and touch charts from its predictions."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from palpate.charts import fit
from palpate.charts.atlas import TOUCH_VERTICES
from palpate.dataset import Dataset
from palpate.models import TouchDepth
from palpate.sensor import DIGIT, Sensor, Size
from palpate.training.data import TrainingDataError
from palpate.training.losses import sheet, touched

PREDICTION_BATCH = 16  # readings: the U-Net's memory grows with their number
READ_BATCH = 16  # objects whose untouched readings are in memory at a time


class Touches(NamedTuple):
    """k successful touches of one split.

    Attributes:
        reading: (k, 3, r, c) uint8. depth: (k, r, c) float32 metres, +inf where nothing is in range.
        empty: (3, r, c) uint8, the reading of an untouched sensor. sensor: the kind that they are of.
    """

    reading: Tensor
    depth: Tensor
    empty: Tensor
    sensor: Sensor = DIGIT

    def __len__(self) -> int:
        return len(self.reading)


def read_touches(dataset: Dataset, *splits: str) -> Touches:
    """The successful touches of some splits whose reading differs from the empty one anywhere.

    dataset: a run's, of the stage `touch`. Raises TrainingDataError if there are none, StoreError for a store that
    can't be read or values that can't be.
    """
    chosen = dataset.select(record.name for record in dataset if record.split in splits)
    readings, depths = [], []
    for first in range(0, len(chosen), READ_BATCH):
        part = chosen[first : first + READ_BATCH]
        success = part.load("touch", "success")
        readings.append(part.load("touch", "reading")[success])
        depths.append(part.load("touch", "depth")[success])
    if not sum(map(len, readings)):
        raise TrainingDataError(f"{dataset!r}: no object of {' or '.join(splits)} was touched: more objects are needed")
    touches = Touches(
        channels_first(np.concatenate(readings)),
        torch.from_numpy(np.concatenate(depths)),
        channels_first(chosen.empty_reading),
        chosen.sensor,
    )
    shown = torch.cat(
        [
            touched(part.float() / 255, touches.empty.float() / 255).any(dim=(1, 2))
            for part in touches.reading.split(256)
        ]
    )
    return Touches(touches.reading[shown], touches.depth[shown], touches.empty, touches.sensor)


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
    method: str = "direct",
) -> np.ndarray:
    """Touch charts of k sensors, from their readings. The same sensors together give the same charts.

    Args:
        model: the trained U-Net, in evaluation mode, on any device.
        reading: (k, r, c, 3) uint8, empty: (r, c, 3) uint8, of the model's sensor.
        success: (k,) bool. position: (k, 3) m, rotation: (k, 3, 3) of the sensors, world frame.
        method: `direct` or `adam`, see `palpate.charts.fit`.

    Returns: (k, 81, 3) float32 metres, world frame; all at the sensor's position for a touch without success.
    """
    charts = np.repeat(position[:, None].astype(np.float32), TOUCH_VERTICES, axis=1)
    sensors = np.flatnonzero(success)
    device = next(model.parameters()).device
    for part in np.array_split(sensors, -(-len(sensors) // PREDICTION_BATCH)) if len(sensors) else []:
        depth, valid = predict_depth(model, channels_first(reading[part]).to(device), channels_first(empty).to(device))
        pose = [torch.from_numpy(array[part]).float() for array in (position, rotation)]
        charts[part] = fit_charts(depth.cpu(), valid.cpu(), *pose, method, model.sensor.size).numpy()
    return charts


def object_charts(model: TouchDepth, touch: Mapping[str, np.ndarray], row: int, method: str = "direct") -> np.ndarray:
    """(g, s, 81, 3) touch charts of all sensors of one object. touch: arrays of a touch store; row: the object's."""
    names = ("success", "position", "rotation")
    sensors = [touch[name][row].reshape(-1, *touch[name].shape[3:]) for name in ("reading", *names)]
    charts = touch_charts(model, sensors[0], touch["empty_reading"], *sensors[1:], method)
    return charts.reshape(*touch["success"].shape[1:], *charts.shape[1:])


@torch.inference_mode()
def predict_depth(model: TouchDepth, reading: Tensor, empty: Tensor) -> tuple[Tensor, Tensor]:
    """Depth (k, r, c) metres, and pixels in contact (k, r, c) bool, of readings (k, 3, r, c) uint8.

    For a reading that hardly differs from the empty one, only the pixel that differs most is in contact.
    """
    reading, empty = reading.float() / 255, empty.float() / 255
    valid = touched(reading, empty)
    faint = ~valid.flatten(1).any(dim=1)
    if faint.any():
        most = (reading[faint] - empty).square().sum(dim=1).flatten(1).argmax(dim=1)
        valid.flatten(1)[faint.nonzero()[:, 0], most] = True
    return model(reading).float(), valid


def fit_charts(depth: Tensor, valid: Tensor, position: Tensor, rotation: Tensor, method: str, size: Size) -> Tensor:
    """Charts (k, 81, 3) fitted to predicted depths (k, r, c) of sensors of a size (m) at the valid pixels; world."""
    if method == "direct":
        return fit.fit_direct(depth, valid, position, rotation, size)
    clouds = [
        points[mask] @ turn.T + origin
        for points, mask, turn, origin in zip(sheet(depth, size), valid, rotation, position, strict=True)
    ]
    return fit.fit_adam(clouds, position, rotation, generator=torch.Generator().manual_seed(0), size=size)
