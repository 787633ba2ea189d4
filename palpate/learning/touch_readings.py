"""Successful touches: the U-Net's training data."""

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from palpate.dataset import Dataset
from palpate.learning.data import ExperimentDataError
from palpate.learning.touch_charts import channels_first, touched
from palpate.sensor import DIGIT, Sensor

READ_BATCH = 16  # objects whose untouched readings are in memory at a time


class Touches(NamedTuple):
    """k successful touches of one split.

    reading: (k, 3, r, c) uint8. depth: (k, r, c) float32 metres, +inf where nothing is in range. empty: (3, r, c)
    uint8, the reading of an untouched sensor. sensor: the kind that they are of.
    """

    reading: Tensor
    depth: Tensor
    empty: Tensor
    sensor: Sensor = DIGIT

    def __len__(self) -> int:
        return len(self.reading)


def read_touches(dataset: Dataset, *splits: str) -> Touches:
    """The successful touches of some splits whose reading differs from the empty one anywhere.

    dataset: a run's, of the stage `touch`. Raises ExperimentDataError if there are none, StoreError for a store that
    can't be read or values that can't be.
    """
    chosen = dataset.select(record.name for record in dataset if record.split in splits)
    readings, depths = [], []
    for first in range(0, len(chosen), READ_BATCH):
        batch = chosen[first : first + READ_BATCH]
        success = batch.load("touch", "success")
        readings.append(batch.load("touch", "reading")[success])
        depths.append(batch.load("touch", "depth")[success])
    if not sum(map(len, readings)):
        raise ExperimentDataError(
            f"{dataset!r}: no object of {' or '.join(splits)} was touched: more objects are needed"
        )
    touches = Touches(
        channels_first(np.concatenate(readings)),
        torch.from_numpy(np.concatenate(depths)),
        channels_first(chosen.empty_reading),
        chosen.sensor,
    )
    empty = touches.empty.float() / 255
    shown = [touched(readings.float() / 255, empty).any(dim=(1, 2)) for readings in touches.reading.split(256)]
    shown = torch.cat(shown)
    return Touches(touches.reading[shown], touches.depth[shown], touches.empty, touches.sensor)
