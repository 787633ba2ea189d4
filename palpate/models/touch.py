"""How touch enters the deformation of the vision charts: pooled near each vertex, and looked up from far ones."""

from collections.abc import Mapping
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from palpate.charts import build_tree, nearest
from palpate.charts.atlas import TOUCH_SIDE
from palpate.charts.chamfer import cKDTree

NEAR, NEARER = 0.05, 0.015  # m, the lengths over which a touch fades
ACROSS = 0.02  # m, the unit of the distance along the normal
FEATURES = 7


class TouchedSurface(NamedTuple):
    """What the successful touches of a batch know of the surface.

    Attributes:
        points: of each sample, the vertices (n, 3) of its successful charts, metres, world; n is 0 without any.
        normals: of each sample, unit normals (n, 3) there, out of the object.
        trees: of each sample, its k-d tree on a CPU, else None.
    """

    points: list[Tensor]
    normals: list[Tensor]
    trees: list[cKDTree | None]


def chart_normals(charts: Tensor) -> Tensor:
    """Unit normals (..., 81, 3) of touch charts (..., 81, 3), towards the sensor: by central differences.

    A place where the chart is folded to a line has the normal 0.
    """
    grid = charts.unflatten(-2, (TOUCH_SIDE, TOUCH_SIDE))
    down, right = torch.gradient(grid, dim=(-3, -2))
    return functional.normalize(torch.linalg.cross(down, right), dim=-1).flatten(-3, -2)


def touched_surface(charts: Tensor, success: Tensor) -> TouchedSurface:
    """charts: (B, T, 81, 3), not read where success (B, T) is False."""
    points = [chart[touched].flatten(0, 1) for chart, touched in zip(charts, success, strict=True)]
    normals = [chart_normals(chart[touched]).flatten(0, 1) for chart, touched in zip(charts, success, strict=True)]
    trees = [build_tree(cloud) if len(cloud) and cloud.device.type == "cpu" else None for cloud in points]
    return TouchedSurface(points, normals, trees)


class TouchPooling(nn.Module):
    """Features of the nearest touched surface at each vertex, times weights that start at zero.

    As image features are pooled where a vertex is seen. With o the offset (m) to the nearest vertex of a successful
    touch chart, r its length, n the chart's unit normal there, and w = exp(-r / 0.05), the features are o w / 0.05,
    w, exp(-r / 0.015), (o . n) w / 0.02, and 1; all are 0 if nothing was touched. The search for the nearest has no
    gradient, the offset has.
    """

    def __init__(self, width: int):
        super().__init__()
        self.weight = nn.Parameter(torch.zeros(FEATURES, width))

    def forward(self, surface: TouchedSurface, positions: Tensor) -> Tensor:
        """positions (V, B, 3) -> (V, B, width)."""
        features = pooled_touch(surface, positions)
        return features @ self.weight.to(features.dtype)


def pooled_touch(surface: TouchedSurface, positions: Tensor) -> Tensor:
    """The features (V, B, 7) that `TouchPooling` describes, at positions (V, B, 3)."""
    pooled = []
    for place, points, normals, tree in zip(positions.unbind(1), *surface, strict=True):
        if not len(points):
            pooled.append(place.new_zeros(len(place), FEATURES))
            continue
        index = nearest(place, points, tree)
        offset = points[index] - place
        distance = torch.linalg.vector_norm(offset, dim=1, keepdim=True)
        near = torch.exp(-distance / NEAR)
        across = (offset * normals[index]).sum(dim=1, keepdim=True)
        features = [offset * near / NEAR, near, torch.exp(-distance / NEARER), across * near / ACROSS]
        pooled.append(torch.cat([*features, torch.ones_like(near)], dim=1))
    return torch.stack(pooled, dim=1)


class TouchAttention(nn.Module):
    """What each vertex takes from all touches, near or far: attention, whose output's weights start at zero.

    A touch is told by its position and its sensor's direction, by whether it succeeded, and by the shape of its chart.
    The order and the number of the touches do not matter.

    width: of the output. channels: of keys and values.
    """

    GRID = slice(0, None, 4)  # Each fourth vertex along a side of a chart: 3 x 3 of them.

    def __init__(self, width: int, channels: int = 64):
        super().__init__()
        told = 3 + 3 + 1 + 27
        self.touch = nn.Sequential(nn.Linear(told, channels), nn.ReLU(), nn.Linear(channels, channels), nn.ReLU())
        self.key = nn.Linear(channels, channels // 2)
        self.query = nn.Sequential(nn.Linear(3, channels), nn.ReLU(), nn.Linear(channels, channels // 2))
        self.weight = nn.Parameter(torch.zeros(channels, width))

    def tokens(self, batch: Mapping[str, Tensor], relative) -> tuple[Tensor, Tensor]:
        success = batch["success"].bool()[..., None]
        grid = batch["charts"].unflatten(2, (TOUCH_SIDE, TOUCH_SIDE))[:, :, self.GRID, self.GRID].flatten(2, 3)
        centre = torch.where(success, grid[:, :, 4], batch["position"])
        shape = torch.where(success[..., None], (grid - centre[:, :, None]) / ACROSS, 0.0).flatten(2)
        told = torch.cat([relative(centre), batch["rotation"][..., 0], success.to(shape.dtype), shape], dim=2)
        hidden = self.touch(told)
        return self.key(hidden), hidden @ self.weight

    def forward(self, tokens: tuple[Tensor, Tensor], relative: Tensor) -> Tensor:
        """relative positions (V, B, 3) -> (V, B, width)."""
        keys, values = tokens
        scores = self.query(relative).transpose(0, 1) @ keys.transpose(1, 2) / keys.shape[2] ** 0.5
        return (scores.softmax(dim=2) @ values).transpose(0, 1)
