"""How touch enters the deformation of the vision charts: pooled near each vertex, and looked up from far ones."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import torch
from scipy.spatial import cKDTree
from torch import Tensor, nn
from torch.nn import functional

from palpate.charts import build_tree, nearest
from palpate.charts.atlas import TOUCH_SIDE
from palpate.sensor import DIGIT, Sensor

NEARER, NEAR, FAR = 0.015, 0.05, 0.15  # m, the lengths over which a touch fades
ACROSS = 0.02  # m, the unit of the distance along the normal
EMPTY = 0.01  # m, the length over which the space before a sensor without success fades
GRID = slice(0, None, 4)  # each fourth vertex along a side of a chart
SURFACE_FEATURES, EMPTY_FEATURES = 14, 5


class Touches(NamedTuple):
    """The touches of one sample, world frame, m: points (n, 3) of successful charts, their unit normals (n, 3) out of
    the object, the points' k-d tree on a CPU; position (m, 3), rotation (m, 3, 3) of the sensors without success."""

    points: Tensor
    normals: Tensor
    tree: cKDTree | None
    position: Tensor
    rotation: Tensor


def chart_normals(charts: Tensor) -> Tensor:
    """Unit normals (..., 81, 3) of touch charts (..., 81, 3), towards the sensor; 0 where folded to a line."""
    grid = charts.unflatten(-2, (TOUCH_SIDE, TOUCH_SIDE))
    down, right = torch.gradient(grid, dim=(-3, -2))
    return functional.normalize(torch.linalg.cross(down, right), dim=-1).flatten(-3, -2)


def chart_grid(charts: Tensor) -> Tensor:
    """3 x 3 vertices (B, T, 9, 3) of touch charts (B, T, 81, 3)."""
    return charts.unflatten(2, (TOUCH_SIDE, TOUCH_SIDE))[:, :, GRID, GRID].flatten(2, 3)


def touches_of(batch: Mapping[str, Tensor]) -> list[Touches]:
    """The touches of each sample of a batch, as `Reconstruction` takes it. Charts without success are not read."""
    touches = []
    for sample, success in enumerate(batch["success"].bool()):
        charts = batch["charts"][sample][success]
        points = charts.flatten(0, 1)
        tree = build_tree(points) if len(points) and points.device.type == "cpu" else None
        poses = batch["position"][sample][~success], batch["rotation"][sample][~success]
        touches.append(Touches(points, chart_normals(charts).flatten(0, 1), tree, *poses))
    return touches


class TouchPooling(nn.Module):
    """Features of the nearest touches at a vertex, times weights that start at zero.
    Of the nearest touched surface: with o the offset (m) to the nearest vertex of a successful touch chart, r its
    length, n the chart's unit normal there, w = exp(-r / 0.05) and v = exp(-r / 0.15): o w / 0.05, w, exp(-r / 0.015),
    (o . n) w / 0.02, n w, o v / 0.15, v, and 1. All are 0 if nothing was touched.
    Of the nearest empty space: a sensor without success has no surface in its reach, a box before it of the sensor's
    size and as deep as its range. With d the distance (m) to the nearest such box, e = exp(-d / 0.01), a the sensor's
    direction, and x the distance (m) from the sensor's plane: e, a e, and x e / range. All are 0 if there is none.
    The search for the nearest has no gradient, the features have. width: of the output. sensor: that touches."""

    def __init__(self, width: int, sensor: Sensor = DIGIT):
        super().__init__()
        self.sensor = sensor
        self.weight = nn.Parameter(torch.zeros(SURFACE_FEATURES + EMPTY_FEATURES, width))

    def forward(self, touches: Sequence[Touches], positions: Tensor) -> Tensor:
        """positions (V, B, 3), metres, world -> (V, B, width)."""
        features = pooled_touches(touches, positions, self.sensor)
        return features @ self.weight.to(features.dtype)


def pooled_touches(touches: Sequence[Touches], positions: Tensor, sensor: Sensor = DIGIT) -> Tensor:
    """The features (V, B, 19) that `TouchPooling` describes, at positions (V, B, 3)."""
    pooled = [
        torch.cat([_surface_features(sample, place), _empty_features(sample, place, sensor)], dim=1)
        for sample, place in zip(touches, positions.unbind(1), strict=True)
    ]
    return torch.stack(pooled, dim=1)


def _surface_features(touches: Touches, place: Tensor) -> Tensor:
    """(V, 14) of the nearest touched surface."""
    if not len(touches.points):
        return place.new_zeros(len(place), SURFACE_FEATURES)
    # A NaN position gets any nearest vertex, and NaN features.
    index = nearest(place.detach().nan_to_num(), touches.points, touches.tree)
    offset, normal = touches.points[index] - place, touches.normals[index]
    distance = torch.linalg.vector_norm(offset, dim=1, keepdim=True)
    nearer, near, far = (torch.exp(-distance / length) for length in (NEARER, NEAR, FAR))
    across = (offset * normal).sum(dim=1, keepdim=True)
    near_features = [offset * near / NEAR, near, nearer, across * near / ACROSS, normal * near]
    return torch.cat([*near_features, offset * far / FAR, far, torch.ones_like(far)], dim=1)


def _empty_features(touches: Touches, place: Tensor, sensor: Sensor) -> Tensor:
    """(V, 5) of the nearest empty space."""
    if not len(touches.position):
        return place.new_zeros(len(place), EMPTY_FEATURES)
    with torch.no_grad():
        local = torch.einsum("vmk,mkj->vmj", place[:, None] - touches.position, touches.rotation)
        index = _outside(local, sensor).argmin(dim=1)
    position, rotation = touches.position[index], touches.rotation[index]
    local = ((place - position)[:, None] @ rotation)[:, 0]
    empty = torch.exp(-_outside(local, sensor)[:, None] / EMPTY)
    return torch.cat([empty, rotation[..., 0] * empty, local[:, :1] / sensor.range * empty], dim=1)


def _outside(local: Tensor, sensor: Sensor) -> Tensor:
    """Distance (...), metres, of points (..., 3) in a sensor's frame to the box of its reach; 0 within."""
    half = local.new_tensor([sensor.range, sensor.width, sensor.height]) / 2
    beyond = (local - local.new_tensor([sensor.range / 2, 0, 0])).abs() - half
    return torch.linalg.vector_norm(beyond.clamp(min=0), dim=-1)


class TouchAttention(nn.Module):
    """Features of all touches, near or far, at a vertex: scaled dot-product attention (Vaswani et al. 2017) with one
    head, whose output's weights start at zero. A query is made of a vertex's position; a key and a value of each touch,
    of its sensor's position and direction, its success and its chart's shape. width: of the output."""

    TOUCH_INPUTS = 3 + 3 + 1 + 9 * 3

    def __init__(self, width: int, channels: int = 64):
        super().__init__()
        inputs = self.TOUCH_INPUTS
        self.touch = nn.Sequential(nn.Linear(inputs, channels), nn.ReLU(), nn.Linear(channels, channels), nn.ReLU())
        self.key = nn.Linear(channels, channels // 2)
        self.query = nn.Sequential(nn.Linear(3, channels), nn.ReLU(), nn.Linear(channels, channels // 2))
        self.weight = nn.Parameter(torch.zeros(channels, width))

    def keys_and_values(
        self, batch: Mapping[str, Tensor], relative: Callable[[Tensor], Tensor]
    ) -> tuple[Tensor, Tensor]:
        """Keys (B, T, channels / 2), and values times the output's weights (B, T, width), of the touches of a batch.
        relative: from positions (..., 3) to those that the network takes."""
        success = batch["success"].bool()[..., None]
        grid = chart_grid(batch["charts"])
        centre = torch.where(success, grid[:, :, 4], batch["position"])
        shape = torch.where(success[..., None], (grid - centre[:, :, None]) / ACROSS, 0.0).flatten(2)
        inputs = torch.cat([relative(centre), batch["rotation"][..., 0], success.to(shape.dtype), shape], dim=2)
        features = self.touch(inputs)
        return self.key(features), features @ self.weight

    def forward(self, keys: Tensor, values: Tensor, relative: Tensor) -> Tensor:
        """Features (V, B, width) of vertices at relative positions (V, B, 3)."""
        query = self.query(relative).transpose(0, 1)
        return functional.scaled_dot_product_attention(query, keys, values).transpose(0, 1)
