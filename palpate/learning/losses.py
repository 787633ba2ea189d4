"""The losses: Chamfer distances in the tables' unit (`palpate.protocol.CHAMFER_SCALE` times square metres)."""

from collections.abc import Sequence

import torch
from scipy.spatial import cKDTree
from torch import Tensor

from palpate.charts import build_tree, one_sided_distance, plane_normals, sample_faces
from palpate.learning.touch_charts import depth_to_points
from palpate.models import Reconstruction
from palpate.models.single_image import occupied
from palpate.protocol import CHAMFER_SCALE
from palpate.sensor import DIGIT, Size


class Truth:
    """True surface points of objects (o, n, 3); what is derived from them is made when it is first asked for."""

    def __init__(self, points: Tensor):
        self.points = points
        self._trees: dict[int, cKDTree] = {}
        self._normals: dict[int, Tensor] = {}
        self._occupied: dict[int, Tensor] = {}

    def clouds(self, objects: Sequence[int]) -> list[Tensor]:
        """The clouds of the numbered objects."""
        return [self.points[number] for number in objects]

    def trees(self, objects: Sequence[int]) -> list[cKDTree] | None:
        """Their trees; None on a GPU, where neighbours are found without."""
        if self.points.device.type != "cpu":
            return None
        for number in set(objects) - set(self._trees):
            self._trees[number] = build_tree(self.points[number])
        return [self._trees[number] for number in objects]

    def normals(self, objects: Sequence[int]) -> list[Tensor]:
        """The unit normals (n, 3) at their points, of either sign."""
        for number in set(objects) - set(self._normals):
            points = self.points[number]
            cloud = points.detach().cpu().double().numpy()
            tree = self._trees.get(number) or build_tree(points)
            self._normals[number] = torch.from_numpy(plane_normals(cloud, tree)).to(points)
        return [self._normals[number] for number in objects]

    def occupied(self, objects: Sequence[int], relative_size: float = 1.0) -> list[Tensor]:
        """Their cells (32, 32, 32) bool, as `palpate.models.single_image.occupied` has them, of one size of grid."""
        for number in set(objects) - set(self._occupied):
            self._occupied[number] = occupied(self.points[number], relative_size)
        return [self._occupied[number] for number in objects]


def reconstruction_loss(
    vertices: Tensor, faces: Tensor, truth: Truth, objects: Sequence[int], n: int, generator: torch.Generator
) -> Tensor:
    """Chamfer distance (B,) of each predicted mesh to its object (paper, equation 2), differentiable in the vertices.

    vertices: (B, V, 3) metres, faces: (F, 3). objects: B numbers of objects in `truth`. n: points sampled on each mesh,
    and taken of the true ones. Each of the former looks for the nearest of all true points, each of the latter for the
    nearest sampled one. generator: of the random choices.
    """
    return cloud_loss(sample_faces(vertices.to(truth.points.dtype), faces, n, generator), truth, objects, n, generator)


def moving_charts_loss(
    model: Reconstruction,
    predictions: Sequence[Tensor],
    truth: Truth,
    objects: Sequence[int],
    n: int,
    generator: torch.Generator,
) -> Tensor:
    """`reconstruction_loss` (B,) of the charts that move, of the last of the model's `stages`.

    The others give no gradient, and would at the start be the nearest to up to half of the true points.
    """
    vertices = predictions[-1]
    faces = model.moving_faces[(model.moving_faces < vertices.shape[1]).all(dim=1)]
    return reconstruction_loss(vertices, faces, truth, objects, n, generator)


def cloud_loss(points: Tensor, truth: Truth, objects: Sequence[int], n: int, generator: torch.Generator) -> Tensor:
    """Chamfer distance of predicted points (B, m, 3) to their objects, as `reconstruction_loss` has it: (B,)."""
    points, clouds = points.to(truth.points.dtype), truth.clouds(objects)
    there = one_sided_distance(points, clouds, truth.trees(objects))
    back = one_sided_distance([subsample(cloud, n, generator) for cloud in clouds], points)
    return CHAMFER_SCALE * (there + back)


def subsample(points: Tensor, n: int | None, generator: torch.Generator) -> Tensor:
    """n random rows, without repetition; all rows if there are no more or n is None."""
    if n is None or n >= len(points):
        return points
    order = torch.randperm(len(points), generator=generator, device=generator.device)[:n]
    return points[order.to(points.device)]


def touch_depth_loss(
    predicted: Tensor, valid: Tensor, depth: Tensor, n: int | None, generator: torch.Generator, size: Size = DIGIT.size
) -> Tensor:
    """Chamfer distance (B,) between the predicted and the true local cloud of each touch (paper, section 3.2).

    predicted: (B, r, c) metres from the sensor plane. valid: (B, r, c) bool, the pixels whose prediction counts. depth:
    (B, r, c) true depth, +inf where nothing is in range. n: points of either cloud that look for the nearest of all in
    the other; None: all. size: of the sensors, in whose frame clouds are compared: a distance does not depend on it.

    Raises ValueError if a touch has no valid pixel or nothing in range.
    """
    in_range = torch.isfinite(depth)
    for what, pixels in (("valid pixel", valid), ("pixel in range", in_range)):
        without = ~pixels.flatten(1).any(dim=1)
        if without.any():
            raise ValueError(f"touch {int(without.nonzero()[0])} of the batch has no {what}: leave it out")
    clouds = [cloud[mask] for cloud, mask in zip(depth_to_points(predicted.to(depth.dtype), size), valid, strict=True)]
    truths = [cloud[mask] for cloud, mask in zip(depth_to_points(depth, size), in_range, strict=True)]
    there = one_sided_distance([subsample(cloud, n, generator) for cloud in clouds], truths)
    back = one_sided_distance([subsample(truth, n, generator) for truth in truths], clouds)
    return CHAMFER_SCALE * (there + back)
