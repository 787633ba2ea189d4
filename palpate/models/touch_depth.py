"""From a touch reading to the depth of the impression: the supplement's U-Net."""

from functools import partial

import torch
from torch import nn

from palpate.models.encoder import ConvolutionBlock
from palpate.sensor import DIGIT, Sensor

# Metres of impression for one unit of the network's output. The gel stands 18 to 20 mm above the sensor plane
# and the sensor's range is 25 mm: impressions are up to 7 mm deep.
IMPRESSION = 0.005


class TouchDepth(nn.Module):
    """The supplement's "U-Net style network": reading -> distance from the sensor plane. width: channels of the first
    level (the paper's 64), doubled at each of the four below. Its output is the impression's depth D' in units of
    `IMPRESSION`, the distance w - D' (supplement, "Simulating Touch"): an output of 0 is the undeformed gel."""

    def __init__(self, width: int = 64, sensor: Sensor = DIGIT):
        super().__init__()
        self.sensor = sensor
        # (r, c) metres from the sensor plane, of the undeformed gel.
        self.gel = nn.Buffer(torch.from_numpy(sensor.range - sensor.sag), persistent=False)
        channels = [width * 2**level for level in range(5)]
        self.down = nn.ModuleList()
        self.pool = nn.ModuleList(nn.MaxPool2d(2) for _ in channels[1:])
        same, inputs = partial(ConvolutionBlock, padding=1), 3
        for outputs in channels:
            self.down.append(nn.Sequential(same(inputs, outputs), same(outputs, outputs)))
            inputs = outputs
        self.upsample, self.up = nn.ModuleList(), nn.ModuleList()
        sizes = [tuple(edge >> level for edge in sensor.resolution) for level in range(5)]
        for level in (3, 2, 1, 0):
            # 12 -> 25, for example, needs one more row and column than twice as many.
            missing = sizes[level][0] - 2 * sizes[level + 1][0], sizes[level][1] - 2 * sizes[level + 1][1]
            self.upsample.append(nn.ConvTranspose2d(2 * channels[level], channels[level], 2, 2, output_padding=missing))
            self.up.append(same(2 * channels[level], channels[level]))
        self.depth = nn.Conv2d(width, 1, 1)

    def forward(self, reading: torch.Tensor) -> torch.Tensor:
        """(B, 3, r, c) reading in [0, 1] -> (B, r, c) metres from the sensor plane along its x. Rows and columns are
        the reading's. Raises ValueError if the shape is another."""
        rows, columns = self.sensor.resolution
        if reading.ndim != 4 or tuple(reading.shape[1:]) != (3, rows, columns):
            raise ValueError(
                f"reading has shape {tuple(reading.shape)}, expected (B, 3, {rows}, {columns}) of {self.sensor.name}"
            )
        levels, x = [], reading
        for level, down in enumerate(self.down):
            x = down(self.pool[level - 1](x) if level else x)
            levels.append(x)
        levels.pop()
        for upsample, up in zip(self.upsample, self.up, strict=True):
            x = up(torch.cat([upsample(x), levels.pop()], dim=1))
        impression = self.depth(x)[:, 0]
        # In float32 at least: in bfloat16 a depth of 20 mm is good to 0.06 mm.
        impression = impression.to(torch.promote_types(impression.dtype, torch.float32))
        return self.gel.to(impression.dtype) - IMPRESSION * impression
