"""The atlas: vision charts that close a sphere, and the touch chart.
A vision chart has 19 vertices and 24 faces (paper, section 3): a hexagonal patch of radius 2, its boundary laid along
the sides of a triangle, four steps a side. The triangles are those of a tetrakis hexahedron (a cube with a low pyramid
on each face), each split in 4 on the sphere: 96, of 50 corners (docs/charts.md)."""

import math
from functools import cache
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from palpate.architectures import ATLAS_RADIUS
from palpate.mesh import DIAGONAL, OBJECT_POSITION
from palpate.sensor import DIGIT, Size

VISION_CHARTS = 96
CHART_VERTICES = 19
CHART_BOUNDARY = 12
TOUCH_SIDE = 9  # vertices along a side of a touch chart: 81 vertices, 128 faces (paper, section 3)
TOUCH_VERTICES = TOUCH_SIDE**2

STEPS = CHART_BOUNDARY // 3  # along each side of a chart
# A chart's vertices: 12 on its boundary, counterclockwise from outside, six around the centre, the centre.
RING, CENTRE = CHART_BOUNDARY, CHART_BOUNDARY + 6


class Atlas(NamedTuple):
    """The vision charts on the sphere. vertices: (1824, 3) float32 m, world frame, 19 a chart, its boundary first.
    faces: (2304, 3) int64, 24 a chart, counterclockwise from outside. chart: (1824,) of each vertex. boundary: (1152,)
    vertices on boundaries, 12 a chart. joined: (1128, 2) pairs of boundary vertices of different charts at one
    position, each once. position: (1824,) which of the 1154 vertices of `sphere()` each lies on."""

    vertices: Tensor
    faces: Tensor
    chart: Tensor
    boundary: Tensor
    joined: Tensor
    position: Tensor


class TouchChart(NamedTuple):
    """The touch chart, a regular grid of the sensor's size. grid: (81, 2) float32 m on the sensor plane, y along
    columns and z along rows. faces: (128, 3) int64, towards the sensor (-x), out of what is touched. centre: the
    reference vertex, which is joined to the vision charts."""

    grid: Tensor
    faces: Tensor
    centre: int


def patch_faces() -> np.ndarray:
    """(24, 3) faces of one vision chart, counterclockwise."""
    faces = []
    for j in range(6):
        before, middle, after = 2 * j, 2 * j + 1, (2 * j + 2) % CHART_BOUNDARY
        inner, following = RING + j, RING + (j + 1) % 6
        faces += [(before, middle, inner), (middle, following, inner)]
        faces += [(middle, after, following), (inner, following, CENTRE)]
    return np.array(faces)


def patch_weights() -> np.ndarray:
    """(19, 3) barycentric coordinates of a chart's vertices in its triangle: the boundary evenly along the
    sides, each inner vertex the mean of its neighbours (Tutte's embedding)."""
    weights = np.zeros((CHART_VERTICES, 3))
    for vertex in range(CHART_BOUNDARY):
        side, step = divmod(vertex, STEPS)
        weights[vertex, side] = 1 - step / STEPS
        weights[vertex, (side + 1) % 3] = step / STEPS
    laplacian = np.zeros((CHART_VERTICES, CHART_VERTICES))
    faces = patch_faces()
    laplacian[faces, np.roll(faces, 1, axis=1)] = laplacian[np.roll(faces, 1, axis=1), faces] = -1
    np.fill_diagonal(laplacian, -laplacian.sum(axis=1))
    inner, outer = laplacian[RING:, RING:], laplacian[RING:, :RING]
    weights[RING:] = np.linalg.solve(inner, -outer @ weights[:RING])
    return weights


def on_unit_sphere(points: np.ndarray) -> np.ndarray:
    """Points (..., 3) moved along their rays to distance 1."""
    return points / np.linalg.norm(points, axis=-1, keepdims=True)


def base_triangles() -> tuple[np.ndarray, np.ndarray]:
    """Corners (50, 3) on the unit sphere and triangles (96, 3), counterclockwise from outside."""
    cube = np.array(list(product((-1.0, 1.0), repeat=3)))
    peaks = np.concatenate([np.eye(3), -np.eye(3)])
    corners = [*on_unit_sphere(cube), *peaks]
    midpoints: dict[tuple[int, int], int] = {}

    def midpoint(a: int, b: int) -> int:
        key = (min(a, b), max(a, b))
        if key not in midpoints:
            midpoints[key] = len(corners)
            corners.append(on_unit_sphere(corners[a] + corners[b]))
        return midpoints[key]

    triangles = []
    for top, peak in enumerate(peaks, start=len(cube)):
        around = [corner for corner in range(len(cube)) if cube[corner] @ peak > 0]
        for a, b in combinations(around, 2):
            if (cube[a] != cube[b]).sum() != 1:  # not an edge of the cube
                continue
            if np.linalg.det([peak, cube[a], cube[b]]) < 0:
                a, b = b, a
            sides = midpoint(top, a), midpoint(a, b), midpoint(b, top)
            triangles += [(top, sides[0], sides[2]), (sides[0], a, sides[1]), (sides[2], sides[1], b), sides]
    return np.array(corners), np.array(triangles)


@cache
def welded_patches() -> tuple[np.ndarray, np.ndarray]:
    """Directions (1154, 3) of the atlas's distinct vertices, and (96, 19) which of them each chart has."""
    corners, triangles = base_triangles()
    weights = patch_weights()
    known: dict[tuple, int] = {}
    directions: list[np.ndarray] = []
    index = np.zeros((len(triangles), CHART_VERTICES), dtype=np.int64)
    for chart, triangle in enumerate(triangles):
        for vertex, weight in enumerate(weights):
            # A boundary vertex is known by the corners it lies between, the same from either side.
            key: tuple = tuple(sorted((corner, w) for corner, w in zip(triangle, weight, strict=True) if w))
            if vertex >= CHART_BOUNDARY:
                key = (chart, vertex)
            if key not in known:
                known[key] = len(directions)
                directions.append(on_unit_sphere(weight @ corners[triangle]))
            index[chart, vertex] = known[key]
    return np.array(directions), index


def placed(directions: np.ndarray) -> Tensor:
    """Vertices (n, 3) float32 on the atlas's sphere."""
    return torch.from_numpy((directions * ATLAS_RADIUS + OBJECT_POSITION).astype(np.float32))


def radius_around(diagonal: float) -> float:
    """Radius (m, in whole mm) of a sphere around objects up to a diagonal (m), as the atlas around 0.5 m."""
    return math.ceil(1000 * diagonal * (ATLAS_RADIUS / DIAGONAL) - 1e-6) / 1000


def resized(vertices: Tensor, radius: float) -> Tensor:
    """A copy of vertices (n, 3) on the atlas's sphere, on the sphere of another radius (m) around the same centre."""
    centre = torch.tensor(OBJECT_POSITION, dtype=torch.float64)
    return (centre + (vertices.double() - centre) * (radius / ATLAS_RADIUS)).to(vertices.dtype)


@cache
@torch.inference_mode(False)  # kept for all later uses, whatever the first one
def vision_atlas() -> Atlas:
    """The 96 vision charts as a closed sphere of radius `ATLAS_RADIUS` around `OBJECT_POSITION`."""
    directions, index = welded_patches()
    starts = np.arange(VISION_CHARTS)[:, None] * CHART_VERTICES
    faces = (patch_faces()[None] + starts[:, :, None]).reshape(-1, 3)
    boundary = (np.arange(CHART_BOUNDARY) + starts).ravel()
    position = index.ravel()
    meeting: dict[int, list[int]] = {}
    for vertex in boundary:
        meeting.setdefault(position[vertex], []).append(vertex)
    joined = [pair for vertices in meeting.values() for pair in combinations(vertices, 2)]
    return Atlas(
        vertices=placed(directions[position]),
        faces=torch.from_numpy(faces),
        chart=torch.arange(VISION_CHARTS).repeat_interleave(CHART_VERTICES),
        boundary=torch.from_numpy(boundary),
        joined=torch.tensor(joined, dtype=torch.int64),
        position=torch.from_numpy(position),
    )


@cache
@torch.inference_mode(False)  # kept for all later uses, whatever the first one
def sphere() -> tuple[Tensor, Tensor]:
    """The same sphere as one closed mesh: vertices (1154, 3) float32 metres, world frame; faces (2304, 3)."""
    directions, index = welded_patches()
    return placed(directions), torch.from_numpy(index[:, patch_faces()].reshape(-1, 3))


@cache
@torch.inference_mode(False)  # kept for all later uses, whatever the first one
def touch_chart(size: Size = DIGIT.size) -> TouchChart:
    """The grid of 9 x 9 vertices over the whole plane of a sensor of a size. Its faces are any sensor's."""
    z, y = torch.meshgrid(*(torch.linspace(-edge / 2, edge / 2, TOUCH_SIDE) for edge in size), indexing="ij")
    corner = (torch.arange(TOUCH_SIDE - 1)[:, None] * TOUCH_SIDE + torch.arange(TOUCH_SIDE - 1)).ravel()
    right, below = corner + 1, corner + TOUCH_SIDE
    faces = torch.stack([corner, below, right, right, below, below + 1], dim=1).reshape(-1, 3)
    return TouchChart(torch.stack([y, z], dim=2).reshape(-1, 2), faces, TOUCH_VERTICES // 2)


def chart_faces(touch_charts: int) -> Tensor:
    """Faces (2304 + 128 t, 3) of vision charts and t touch charts, touch chart k from vertex 1824 + 81 k."""
    atlas, touch = vision_atlas(), touch_chart()
    start = len(atlas.vertices) + TOUCH_VERTICES * torch.arange(touch_charts)
    return torch.cat([atlas.faces, (touch.faces + start[:, None, None]).reshape(-1, 3)])
