"""What predictions are compared with in a training, and how: Chamfer distances in the tables' unit
(`palpate.protocol.CHAMFER_SCALE` times square metres). The networks have the losses that they are trained with."""

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
import torch
from scipy.ndimage import binary_fill_holes
from scipy.spatial import cKDTree
from torch import Tensor

from palpate.charts import build_tree, one_sided_distance, plane_normals, sample_faces
from palpate.mesh import DIAGONAL, OBJECT_POSITION
from palpate.protocol import CHAMFER_SCALE

GRID = 32  # cells along an edge of the grid of voxels
CELL = DIAGONAL / GRID  # m: no side of an object's box is longer than its diagonal


class Truth:
    """True surface points of objects (o, n, 3). What is derived from those of one, by its number, is made when it is
    first asked for: its `tree(number)`; the unit `normals(number)` (n, 3) at its points, of either sign; the cells that
    are `occupied(number, relative_size)`, as the function has them."""

    def __init__(self, points: Tensor):
        self.points = points
        self.tree = cache(lambda number: build_tree(self.points[number]))
        self.occupied = cache(lambda number, relative_size=1.0: occupied(self.points[number], relative_size))
        self.normals = cache(self._normals)

    def _normals(self, number: int) -> Tensor:
        tree = self.tree(number)
        return torch.from_numpy(plane_normals(tree.data, tree)).to(self.points)

    def trees(self, objects: Sequence[int]) -> list[cKDTree] | None:
        """Their trees; None on a GPU, where neighbours are found without."""
        return [self.tree(number) for number in objects] if self.points.device.type == "cpu" else None


class Target(NamedTuple):
    """What the predictions of a step are compared with: B numbers of `objects` in `truth`. n: points that are sampled
    on each prediction, and taken of the true ones."""

    truth: Truth
    objects: Sequence[int]
    n: int
    generator: torch.Generator


def occupied(points: Tensor, relative_size: float = 1.0) -> Tensor:
    """The cells (32, 32, 32) bool, along x, y, z, that surface points (n, 3) m lie in or enclose, as the published
    voxels. relative_size: of the grid to a cube with the edge `DIAGONAL`."""
    cell = CELL * relative_size
    index = ((points.detach().cpu().double() - torch.tensor(OBJECT_POSITION)) / cell + GRID / 2).floor().long()
    shell = np.zeros((GRID, GRID, GRID), dtype=bool)
    shell[tuple(index.clamp(0, GRID - 1).numpy().T)] = True
    return torch.from_numpy(binary_fill_holes(shell)).to(points.device)


def reconstruction_loss(vertices: Tensor, faces: Tensor, target: Target) -> Tensor:
    """Chamfer distance (B,) of predicted meshes, (B, V, 3) m and (F, 3), to their objects (paper, equation 2)."""
    points = sample_faces(vertices.to(target.truth.points.dtype), faces, target.n, target.generator)
    return cloud_loss(points, target)


def cloud_loss(points: Tensor, target: Target) -> Tensor:
    """Chamfer distance (B,) of predicted points (B, m, 3) to their objects. Each of them looks for the nearest of all
    true points, each of those that are taken of the true ones for the nearest predicted one."""
    truth, objects, n, generator = target
    points, clouds = points.to(truth.points.dtype), [truth.points[number] for number in objects]
    there = one_sided_distance(points, clouds, truth.trees(objects))
    back = one_sided_distance([subsample(cloud, n, generator) for cloud in clouds], points)
    return CHAMFER_SCALE * (there + back)


def subsample(points: Tensor, n: int | None, generator: torch.Generator) -> Tensor:
    """n random rows, without repetition; all rows if there are no more or n is None."""
    if n is None or n >= len(points):
        return points
    order = torch.randperm(len(points), generator=generator, device=generator.device)[:n]
    return points[order.to(points.device)]
