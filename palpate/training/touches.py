"""Successful touches: what the U-Net learns from, and the touch charts that it leads to."""

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from palpate import store
from palpate.charts import fit
from palpate.models import TouchDepth
from palpate.training.losses import sheet, touched
from palpate.training.pack import PackError

PREDICTED_AT_ONCE = 16  # readings: what the U-Net holds of them grows with their number


class Touches(NamedTuple):
    """k successful touches of one split.

    Attributes:
        reading: (k, 3, 100, 100) uint8. depth: (k, 100, 100) float32 metres, +inf where nothing is in range.
        empty: (3, 100, 100) uint8, the reading of an untouched sensor.
    """

    reading: Tensor
    depth: Tensor
    empty: Tensor

    def __len__(self) -> int:
        return len(self.reading)


def read_touches(stores: Sequence[Path | str], catalogue: Path | str, *splits: str) -> Touches:
    """The successful touches of some splits, from the touch stores of all batches, that differ from the empty
    reading anywhere. Raises PackError if there are none."""
    with open(catalogue, newline="", encoding="utf-8") as file:
        split = {row["object"]: row["split"] for row in csv.DictReader(file)}
    readings, depths = [], []
    for path in stores:
        opened = store.open(path)
        success, names, empty = opened["success"], opened["object"], opened["empty_reading"]
        if not len(names):
            continue
        of_split = np.repeat([split[str(name)] in splits for name in names], len(success) // len(names))
        chosen = success & of_split[:, None]
        readings.append(opened["reading"][chosen])
        depths.append(opened["depth"][chosen])
    if not readings or not sum(map(len, readings)):
        raise PackError(f"{catalogue}: no object of {' or '.join(splits)} was touched: more objects are needed")
    touches = Touches(
        channels_first(np.concatenate(readings)),
        torch.from_numpy(np.concatenate(depths)),
        channels_first(empty),
    )
    shown = torch.cat(
        [
            touched(part.float() / 255, touches.empty.float() / 255).any(dim=(1, 2))
            for part in touches.reading.split(256)
        ]
    )
    return Touches(touches.reading[shown], touches.depth[shown], touches.empty)


def channels_first(images: np.ndarray) -> Tensor:
    """(..., r, r, 3) to (..., 3, r, r)."""
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
    """Touch charts of k sensors, from what they read. The same sensors together give the same charts.

    Args:
        model: the trained U-Net, in evaluation mode, on any device.
        reading: (k, 100, 100, 3) uint8, empty: (100, 100, 3) uint8.
        success: (k,) bool. position: (k, 3) m, rotation: (k, 3, 3) of the sensors, world frame.
        method: `direct` or `adam`, see `palpate.charts.fit`.

    Returns: (k, 81, 3) float32 metres, world frame; all at the sensor's position for a touch without success.
    """
    charts = np.repeat(position[:, None].astype(np.float32), 81, axis=1)
    felt = np.flatnonzero(success)
    device = next(model.parameters()).device
    for some in np.array_split(felt, -(-len(felt) // PREDICTED_AT_ONCE)) if len(felt) else []:
        depth, valid = predict_depth(model, channels_first(reading[some]).to(device), channels_first(empty).to(device))
        pose = [torch.from_numpy(array[some]).float() for array in (position, rotation)]
        charts[some] = fit_charts(depth.cpu(), valid.cpu(), *pose, method).numpy()
    return charts


@torch.inference_mode()
def predict_depth(model: TouchDepth, reading: Tensor, empty: Tensor) -> tuple[Tensor, Tensor]:
    """Depth (k, r, r) metres, and which pixels are touched (k, r, r), of readings (k, 3, r, r) uint8.

    A reading that hardly differs from the empty one still touches: there it is the pixel that differs most.
    """
    reading, empty = reading.float() / 255, empty.float() / 255
    valid = touched(reading, empty)
    faint = ~valid.flatten(1).any(dim=1)
    if faint.any():
        most = (reading[faint] - empty).square().sum(dim=1).flatten(1).argmax(dim=1)
        valid.flatten(1)[faint.nonzero()[:, 0], most] = True
    return model(reading).float(), valid


def fit_charts(depth: Tensor, valid: Tensor, position: Tensor, rotation: Tensor, method: str) -> Tensor:
    """Charts (k, 81, 3) fitted to predicted depths (k, r, r) at the valid pixels; world frame."""
    if method == "direct":
        return fit.fit_direct(depth, valid, position, rotation)
    clouds = [
        points[mask] @ turn.T + origin
        for points, mask, turn, origin in zip(sheet(depth), valid, rotation, position, strict=True)
    ]
    return fit.fit_adam(clouds, position, rotation, generator=torch.Generator().manual_seed(0))
