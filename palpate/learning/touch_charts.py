"""Touch charts from readings, by the U-Net: predicted depths, and charts that are fitted to them."""

from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor

from palpate.charts import fit_direct
from palpate.charts.atlas import TOUCH_VERTICES
from palpate.models import TouchDepth
from palpate.sensor import DIGIT, Size, pixel_centres

PREDICTION_BATCH = 16  # readings: the U-Net's memory grows with their number
# Squared difference of a pixel to the untouched reading, summed over colours in [0, 1], above which it counts
# as touched (supplement, "Optimization Details" of local touch charts).
TOUCHED = 0.001


def touched(reading: Tensor, empty: Tensor) -> Tensor:
    """Which pixels (..., r, c) of readings (..., 3, r, c) in [0, 1] differ from the empty one (3, r, c)."""
    return (reading - empty).square().sum(dim=-3) > TOUCHED


def depth_to_points(depth: Tensor, size: Size = DIGIT.size) -> Tensor:
    """Depths (..., r, c) as points (..., r, c, 3) in the frame of a sensor of a size (height, width), metres: x the
    depth, y along columns, z along rows."""
    centres = [torch.from_numpy(line).to(depth) for line in map(pixel_centres, depth.shape[-2:], size)]
    z, y = torch.meshgrid(*centres, indexing="ij")
    return torch.stack([depth, y.expand_as(depth), z.expand_as(depth)], dim=-1)


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
    """Touch charts (k, 81, 3) float32 of k sensors, from their readings; metres, world frame.

    model: the trained U-Net, in evaluation mode, on any device. reading: (k, r, c, 3) uint8, empty: (r, c, 3) uint8, of
    the model's sensor. success: (k,) bool; charts of a touch without success are at the sensor's position. position:
    (k, 3) m, rotation: (k, 3, 3) of the sensors, world frame.

    The same sensors together give the same charts.
    """
    charts = np.repeat(position[:, None].astype(np.float32), TOUCH_VERTICES, axis=1)
    sensors = np.flatnonzero(success)
    device = next(model.parameters()).device
    for chosen in np.array_split(sensors, -(-len(sensors) // PREDICTION_BATCH)) if len(sensors) else []:
        depth, valid = predict_depth(
            model, channels_first(reading[chosen]).to(device), channels_first(empty).to(device)
        )
        pose = [torch.from_numpy(array[chosen]).float() for array in (position, rotation)]
        charts[chosen] = fit_direct(depth.cpu(), valid.cpu(), *pose, model.sensor.size).numpy()
    return charts


def object_charts(model: TouchDepth, touch: Mapping[str, np.ndarray], row: int) -> np.ndarray:
    """(g, s, 81, 3) touch charts of all sensors of one object. touch: arrays of a touch store; row: the object's."""
    names = ("success", "position", "rotation")
    sensors = [touch[name][row].reshape(-1, *touch[name].shape[3:]) for name in ("reading", *names)]
    charts = touch_charts(model, sensors[0], touch["empty_reading"], *sensors[1:])
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
