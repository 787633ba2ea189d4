"""The losses that the published single-image networks are trained with; validation is by Chamfer distance for all."""

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn import functional

from palpate.charts import nearest, one_sided_distance
from palpate.learning.losses import Truth, cloud_loss, subsample
from palpate.models.single_image import DeformedSphere, PointSet, Voxels
from palpate.protocol import CHAMFER_SCALE, PIXEL2MESH_SCALE

# Weights relative to the Chamfer distance (Wang et al. 2018, section 4). Lengths squared are weighed alike
# whatever their unit; the normal term has none, and its weight is for lengths at the published scale.
LAPLACIAN, EDGE = 0.3, 0.1
NORMAL = 1.6e-4 / PIXEL2MESH_SCALE**2  # m^2


def point_set_loss(
    model: PointSet, stages: Sequence[Tensor], truth: Truth, objects: Sequence[int], n: int, generator: torch.Generator
) -> Tensor:
    """(B,) Chamfer distance of the predicted points to their objects, as `cloud_loss` has it."""
    return cloud_loss(stages[-1], truth, objects, n, generator)


def deformed_sphere_loss(
    model: DeformedSphere,
    stages: Sequence[Tensor],
    truth: Truth,
    objects: Sequence[int],
    n: int,
    generator: torch.Generator,
) -> Tensor:
    """(B,) Pixel2Mesh's loss, the mean over its blocks (the publication: the sum).

    Of each block: the Chamfer distance between vertices and true points, the edges' squared length, the change
    of each vertex's Laplacian coordinate by the block, and how far edges are from tangential at the nearest
    true point. Each is a mean, as in the published code, and times 9000.
    """
    clouds, trees, normals = truth.clouds(objects), truth.trees(objects), truth.normals(objects)
    before = model.start.to(truth.points.dtype).expand(len(objects), -1, -1)
    total = 0
    for vertices in stages:
        vertices = vertices.to(truth.points.dtype)
        index = [nearest(*job) for job in zip(vertices, clouds, trees or [None] * len(clouds), strict=True)]
        at = torch.stack([cloud[i] for cloud, i in zip(clouds, index, strict=True)])
        there = (vertices - at).square().sum(dim=2).mean(dim=1)
        back = one_sided_distance([subsample(cloud, n, generator) for cloud in clouds], vertices)
        edges = vertices[:, model.edges[:, 0]] - vertices[:, model.edges[:, 1]]
        change = laplacian(vertices - before, model.edges)  # the coordinates are linear in the vertices
        normal = torch.stack([of[i] for of, i in zip(normals, index, strict=True)])
        total = (
            total
            + (there + back)
            + EDGE * edges.square().sum(dim=2).mean(dim=1)
            + LAPLACIAN * change.square().sum(dim=2).mean(dim=1)
            + NORMAL * mean_cosine(edges, normal, model.edges)
        )
        before = vertices
    return CHAMFER_SCALE * total / len(stages)


def laplacian(vertices: Tensor, edges: Tensor) -> Tensor:
    """Laplacian coordinates (B, V, 3): each vertex less the mean of its neighbours.

    vertices: (B, V, 3). edges: (E, 2), each once; every vertex has one.
    """
    ends, others = torch.cat([edges, edges.flip(1)]).T
    count = torch.bincount(ends, minlength=vertices.shape[1]).to(vertices.dtype)
    return vertices - torch.zeros_like(vertices).index_add(1, ends, vertices[:, others]) / count[:, None]


def mean_cosine(edges: Tensor, normals: Tensor, ends: Tensor) -> Tensor:
    """(B,) mean absolute cosine between each edge (B, E, 3) and the normals (B, V, 3) at its two ends (E, 2)."""
    unit = functional.normalize(edges, dim=2)
    return torch.stack([(unit * normals[:, end]).sum(dim=2).abs() for end in ends.T]).mean(dim=(0, 2))


def voxel_loss(
    model: Voxels, stages: Sequence[Tensor], truth: Truth, objects: Sequence[int], n: int, generator: torch.Generator
) -> Tensor:
    """(B,) mean cross entropy of the cells, in nats; the true cells are those of all surface points."""
    odds = stages[-1].to(truth.points.dtype)
    there = torch.stack(truth.occupied(objects, model.relative_size)).to(odds.dtype)
    return functional.binary_cross_entropy_with_logits(odds, there, reduction="none").mean(dim=(1, 2, 3))


# By strategy; `palpate.learning.losses.moving_charts_loss` is that of all others.
LOSSES = {"psg": point_set_loss, "pixel2mesh": deformed_sphere_loss, "r2n2": voxel_loss}
