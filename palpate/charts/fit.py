"""Touch charts from depth maps, directly: the paper's optimisation is slower and less exact.

docs/evidence/error_vs_runtime.md has the error and the time of both.
"""

import torch
from torch import Tensor

from palpate.charts.atlas import TOUCH_SIDE
from palpate.sensor import DIGIT, Size


def spread(valid: Tensor, count: int) -> Tensor:
    """Which `count` of the true entries of each row (..., n) lie evenly over all of them, first to last.

    Returns (..., count) int64, ascending; entries repeat where fewer are true, and are 0 where none is.
    """
    rank = valid.cumsum(dim=-1)
    total = rank[..., -1:]
    share = torch.linspace(0, 1, count, dtype=torch.float64, device=valid.device)
    wanted = (share * (total - 1).clamp(min=0)).round().long() + 1
    found = torch.searchsorted(rank.contiguous(), wanted.contiguous())
    return torch.where(total > 0, found, 0)


def fit_direct(depth: Tensor, valid: Tensor, position: Tensor, rotation: Tensor, size: Size = DIGIT.size) -> Tensor:
    """Touch charts (k, 81, 3) of height fields, by resampling: nine of the pixel rows that hold contact, evenly spread,
    and in each of them nine of its pixels in contact. Every vertex is a point of the cloud.

    depth: (k, r, c) metres from the sensor plane at the centres of pixels. valid: (k, r, c) bool, pixels in contact.
    position: (k, 3) metres and rotation: (k, 3, 3) of the sensors; columns are the frame's axes. size: of the sensors.
    The charts are in the frame and type of the positions, vertices ordered as in `touch_chart()`.

    Raises ValueError if a chart has no valid pixel, or a valid depth is NaN or infinite.
    """
    rows, columns = depth.shape[1:]
    if not valid.flatten(1).any(dim=1).all():
        raise ValueError("a depth map without valid pixels has no touch chart; leave it out")
    if not torch.isfinite(depth[valid]).all():
        raise ValueError("a depth map holds NaN or infinity at valid pixels")
    row = spread(valid.any(dim=2), TOUCH_SIDE)  # (k, 9)
    column = spread(valid.gather(1, row[..., None].expand(-1, -1, columns)), TOUCH_SIDE)  # (k, 9, 9)
    row = row[..., None].expand_as(column)
    x = depth.flatten(1).gather(1, (row * columns + column).flatten(1))
    places = zip((column, row), (columns, rows), reversed(size), strict=True)
    y, z = (((at.flatten(1) + 0.5) / count - 0.5) * edge for at, count, edge in places)
    return placed(torch.stack([x, y, z], dim=2), position, rotation)


def placed(points: Tensor, position: Tensor, rotation: Tensor) -> Tensor:
    """Points (k, n, 3) of the sensors' frames in the frame that their poses are given in."""
    return points.to(position.dtype) @ rotation.to(position.dtype).mT + position[:, None]
