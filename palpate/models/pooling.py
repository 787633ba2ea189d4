"""Perceptual feature pooling: the image's feature maps at the projection of each vertex."""

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable
from torch.nn import functional

# Metres in front of the camera; nearer vertices, and those behind it, are taken as that far.
NEAR = 1e-3


def relative_camera(camera: Tensor, size: int) -> Tensor:
    """(..., 3, 4) world to homogeneous pixels of an image of `size` -> the same to [-1, 1] over the image."""
    # No product of matrices: in mixed precision it would be in 16 bits.
    column, row, depth = camera.unbind(dim=-2)
    return torch.stack([column * (2 / size) - depth, row * (2 / size) - depth, depth], dim=-2)


class BilinearSum(torch.autograd.Function):
    """Weighted sums of rows, for bilinear interpolation in several maps at once: table (R, C), row (n, k) int64, weight
    (n, k) -> (n, C). The gradient of the table is the transposed sum, with its terms sorted by row: on a CPU many times
    faster than to scatter them."""

    @staticmethod
    def forward(ctx: Any, table: Tensor, row: Tensor, weight: Tensor) -> Tensor:
        ctx.save_for_backward(table, row, weight)
        return functional.embedding_bag(row, table, mode="sum", per_sample_weights=weight)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        table, row, weight = ctx.saved_tensors
        gradient = gradient.contiguous()
        grad_table = grad_weight = None
        if ctx.needs_input_grad[0]:
            cells = row.flatten()
            if cells.device.type == "cpu":  # numpy sorts 16-bit numbers by radix, five times as fast as torch here
                small = cells.numpy().astype(np.min_scalar_type(len(table)))
                order = torch.from_numpy(np.argsort(small, kind="stable"))
            else:
                order = cells.argsort()
            count = torch.bincount(cells, minlength=len(table))
            start = torch.cat([count.new_zeros(1), count.cumsum(0)])  # of each row in that order, and the end
            grad_table = functional.embedding_bag(
                order // row.shape[1],
                gradient,
                start,
                mode="sum",
                per_sample_weights=weight.flatten()[order],
                include_last_offset=True,
            )
        if ctx.needs_input_grad[2]:
            # On a GPU torch has this gradient in no bfloat16.
            wide = torch.promote_types(weight.dtype, torch.float32)
            with torch.enable_grad():
                variable = weight.detach().to(wide).requires_grad_()
                y = functional.embedding_bag(row, table.detach().to(wide), mode="sum", per_sample_weights=variable)
            (grad_weight,) = torch.autograd.grad(y, variable, gradient.to(wide))
            grad_weight = grad_weight.to(weight.dtype)
        return grad_table, None, grad_weight


def map_products(maps: Sequence[Tensor], weight: Tensor) -> tuple[Tensor, list[int]]:
    """The product of maps, each (B, C_k, h_k, h_k), with weights (sum of C_k, width) in the order of the maps: of a
    sample's maps all cells, row by row, (B * cells, width); and the maps' edges h_k. Pooling is linear in the maps:
    pooled features times weights are the pooled products. These have fewer cells, and fewer channels."""
    parts = weight.split([features.shape[1] for features in maps])
    rows = [
        features.flatten(2).transpose(1, 2) @ part.to(features.dtype)
        for features, part in zip(maps, parts, strict=True)
    ]
    return torch.cat(rows, dim=1).flatten(0, 1), [features.shape[-1] for features in maps]


def pool(maps: Sequence[Tensor], positions: Tensor, camera: Tensor) -> Tensor:
    """The features of each map (B, C, h, h) at each vertex, by bilinear interpolation: (V, B, sum of C).
    A map covers the image from edge to edge, its cells being equal squares (supplement: its projection "corresponds
    exactly to a position in each feature map"). Positions outside take the value at its edge. positions: (V, B, 3) m,
    world. camera: (3, 4) or (B, 3, 4), from the world to [-1, 1] over the image (`relative_camera`)."""
    place = _project(positions, camera)
    pooled = []
    for features in maps:
        row, weight = _cells(place, features.shape[-1])
        row = row + features.shape[-1] ** 2 * torch.arange(len(features), device=row.device)[:, None]
        table = features.flatten(2).transpose(1, 2).flatten(0, 1).contiguous()
        pooled.append(_bilinear_sum(table, row, weight))
    return torch.cat(pooled, dim=2)


def pool_products(table: Tensor, edges: Sequence[int], positions: Tensor, camera: Tensor) -> Tensor:
    """Pooled features times weights (V, B, width), from maps times weights; the rest as in `pool`."""
    place, first = _project(positions, camera), [0, *itertools.accumulate(edge**2 for edge in edges)]
    rows, weights = zip(*(_cells(place, edge) for edge in edges), strict=True)
    row = torch.cat([row + start for row, start in zip(rows, first, strict=False)], dim=2)
    row = row + first[-1] * torch.arange(positions.shape[1], device=positions.device)[:, None]
    return _bilinear_sum(table, row, torch.cat(weights, dim=2))


def _cells(place: Tensor, edge: int) -> tuple[Tensor, Tensor]:
    """The four cells around places (V, B, 2) in a map of `edge` x `edge` cells, and their weights: (V, B, 4)."""
    cell = ((place + 1) * (edge / 2) - 0.5).clamp(0, edge - 1)
    # NaN positions get any cell and NaN weights.
    low = cell.detach().nan_to_num().floor().clamp(max=max(edge - 2, 0))
    right, down = (cell - low).unbind(dim=-1)
    weight = torch.stack([(1 - down) * (1 - right), (1 - down) * right, down * (1 - right), down * right], dim=-1)
    low = low.long()
    corner = low[..., 1] * edge + low[..., 0]
    across, below = min(edge - 1, 1), edge * min(edge - 1, 1)
    return corner[..., None] + corner.new_tensor([0, across, below, below + across]), weight


def _project(positions: Tensor, camera: Tensor) -> Tensor:
    """Positions (V, B, 3) in the image (V, B, 2), -1 to 1 from edge to edge."""
    turned = camera[..., :3].transpose(-1, -2)
    seen = (positions.transpose(0, 1) @ turned + camera[..., None, :, 3]).transpose(0, 1)
    return seen[..., :2] / seen[..., 2:].clamp(min=NEAR)


def _bilinear_sum(table: Tensor, row: Tensor, weight: Tensor) -> Tensor:
    """`BilinearSum` for rows and weights (V, B, k): (V, B, C)."""
    y = BilinearSum.apply(table, row.flatten(0, 1), weight.flatten(0, 1).to(table.dtype))
    return y.unflatten(0, row.shape[:2])
