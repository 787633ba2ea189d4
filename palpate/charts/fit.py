"""Touch charts from local point clouds: directly, or by the paper's optimisation.

docs/evidence/error_vs_runtime.md has the error and the time of both; the direct fit is the default.
"""

from collections.abc import Sequence

import torch
from torch import Tensor

from palpate.charts.atlas import TOUCH_SIDE, touch_chart
from palpate.charts.chamfer import build_tree, chamfer_distance
from palpate.charts.sample import sample_faces
from palpate.protocol import CHAMFER_SCALE
from palpate.sensor import DIGIT, Size

STOP = 0.0006 / CHAMFER_SCALE  # square metres: the supplement's loss to stop at, in the tables' unit


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


def fit_adam(
    points: Sequence[Tensor],
    position: Tensor,
    rotation: Tensor,
    steps: int = 300,
    rate: float = 0.003,
    stop: float = STOP,
    samples: int = 2000,
    generator: torch.Generator | None = None,
    size: Size = DIGIT.size,
) -> Tensor:
    """Touch charts (k, 81, 3) by the paper's optimisation (supplement, "Converting Point Clouds to Charts").

    For all sensors at once: Adam moves the vertices of a plane in place of the sensor, to lower the Chamfer distance
    between the cloud and points sampled on the chart. A chart is that of the step with the lowest loss.

    Args:
        points: k local clouds (n_i, 3) metres, in the frame of the poses, one point or more each.
        position: (k, 3) and rotation: (k, 3, 3) of the sensors. size: theirs.
        steps: at most. rate: Adam's, in metres. stop: a chart is done when its loss falls below this, in square metres.
        samples: points on each chart a step, from `generator` (None: the default one). With 1,000 their own spacing
            exceeds the supplement's `stop`, which is then never reached (docs/charts.md).

    Raises ValueError if a cloud is empty or holds NaN or infinity, or the numbers of clouds and poses differ.
    """
    if len(points) != len(position):
        raise ValueError(f"{len(points)} point clouds for {len(position)} sensors; must be as many")
    chart = touch_chart(size)
    faces = chart.faces.to(position.device)
    trees = [build_tree(cloud) for cloud in points] if position.device.type == "cpu" else [None] * len(points)
    # Tensors made in inference mode could not be differentiated: copies can.
    with torch.inference_mode(False), torch.enable_grad():
        points = [cloud.detach().clone() for cloud in points]
        position, rotation = position.clone(), rotation.clone()
        plane = torch.cat([torch.zeros(len(chart.grid), 1), chart.grid], dim=1).to(position)
        vertices = placed(plane.expand(len(position), -1, -1), position, rotation).detach().requires_grad_()
        best = vertices.detach().clone()
        lowest = torch.full((len(best),), torch.inf, dtype=best.dtype, device=best.device)
        adam = torch.optim.Adam([vertices], lr=rate)
        for _ in range(steps):
            active = (lowest >= stop).nonzero()[:, 0]
            if not len(active):
                break
            sampled = sample_faces(vertices[active], faces, samples, generator)
            numbers = active.tolist()
            loss = chamfer_distance(sampled, [points[i] for i in numbers], b_trees=[trees[i] for i in numbers])
            better = active[loss.detach() < lowest[active]]
            lowest[active] = torch.minimum(lowest[active], loss.detach())
            best[better] = vertices.detach()[better]
            adam.zero_grad()
            loss.sum().backward()
            adam.step()
    return best
