"""Charts from what was measured: touch charts from depth maps, and the atlas on an object's surface.
The paper's optimisation of touch charts is slower and less exact (docs/evidence/error_vs_runtime.md)."""

import torch
from torch import Tensor

from palpate.charts.atlas import ATLAS_RADIUS, TOUCH_SIDE, sphere
from palpate.charts.chamfer import build_tree, one_sided_distance
from palpate.charts.graph import mesh_edges
from palpate.charts.sample import sample_faces
from palpate.mesh import OBJECT_POSITION
from palpate.sensor import DIGIT, Size

START = 0.7  # of an object's box: the ellipsoid that the fit of the atlas begins with
EDGE = 0.2  # weight of the mean squared side of a face beside the Chamfer distance, in the fit of the atlas


def spread(valid: Tensor, count: int) -> Tensor:
    """Which `count` of the true entries of each row (..., n) lie evenly over all of them, first to last. Returns
    (..., count) int64, ascending; entries repeat where fewer are true, and are 0 where none is."""
    rank = valid.cumsum(dim=-1)
    total = rank[..., -1:]
    share = torch.linspace(0, 1, count, dtype=torch.float64, device=valid.device)
    wanted = (share * (total - 1).clamp(min=0)).round().long() + 1
    place = torch.searchsorted(rank.contiguous(), wanted.contiguous())
    return torch.where(total > 0, place, 0)


def fit_direct(depth: Tensor, valid: Tensor, position: Tensor, rotation: Tensor, size: Size = DIGIT.size) -> Tensor:
    """Touch charts (k, 81, 3) by resampling: nine of the pixel rows that hold contact, evenly spread, and in each nine
    of its pixels in contact. depth: (k, r, c) m from the sensor plane; valid: (k, r, c) bool, in contact. position:
    (k, 3) m, rotation: (k, 3, 3) of the sensors, in whose frame and type the charts are; size: theirs. Vertices are
    ordered as in `touch_chart()`. Raises ValueError if a chart has no valid pixel, or one is not finite."""
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


def fit_atlas(points: Tensor, steps: int = 60, rate: float = 0.01, samples: int = 1500) -> Tensor:
    """The vertices (1154, 3) of the atlas's sphere, moved to surface points (n, 3) m of an object, in their type. Adam
    lowers the Chamfer distance to points sampled on the mesh, plus `EDGE` times the mean squared side of its faces
    (Wang et al. 2018, "Pixel2Mesh"). It begins with an ellipsoid in the object's box. steps: of Adam, whose rate (m)
    falls to 0 along a line. samples: points of either cloud in a step. Raises ValueError if there is no point, or one
    is NaN or infinite."""
    generator = torch.Generator().manual_seed(0)
    with torch.inference_mode(False), torch.enable_grad():
        points, (ball, faces) = points.detach().clone(), sphere()
        tree, sides = build_tree(points), mesh_edges(faces)
        low, high = points.amin(dim=0), points.amax(dim=0)
        directions = (ball - ball.new_tensor(OBJECT_POSITION)).to(points.dtype) / ATLAS_RADIUS
        vertices = ((low + high) / 2 + START / 2 * (high - low) * directions).requires_grad_()
        adam = torch.optim.Adam([vertices], lr=rate)
        schedule = torch.optim.lr_scheduler.LinearLR(adam, 1.0, 0.0, steps)
        for _ in range(steps):
            sampled = sample_faces(vertices[None], faces, samples, generator)
            seen = points[torch.randperm(len(points), generator=generator)[:samples]]
            chamfer = one_sided_distance(sampled, [points], [tree]) + one_sided_distance([seen], sampled)
            first, second = vertices[sides].unbind(1)
            adam.zero_grad()
            (chamfer.sum() + EDGE * (first - second).square().sum(dim=1).mean()).backward()
            adam.step()
            schedule.step()
    return vertices.detach()
