"""The visual hull of an object: no part of it projects beside its silhouette (Laurentini 1994, "The visual hull concept
for silhouette-based image understanding")."""

from collections.abc import Mapping

import torch
from torch import Tensor
from torch.nn import functional


def outside(places: Tensor, batch: Mapping[str, Tensor], sample: int) -> Tensor:
    """Whether places (..., 3), m, world frame, are outside the visual hull of a sample of a batch: more than a pixel
    beside its silhouette, whose border pixels show the object in part. Behind the hand and outside the image they may
    be anywhere. batch: `mask` and, if something hides the object, `hand` (B, p, p) bool; `camera` (B, 3, 4), from
    homogeneous world coordinates to their pixels."""
    possible, camera = batch["mask"][sample], batch["camera"][sample].double()
    if "hand" in batch:
        possible = possible | batch["hand"][sample]
    near = functional.max_pool2d(possible[None].float(), 3, stride=1, padding=1)[0] > 0
    across, down, depth = (places.double() @ camera[:, :3].T + camera[:, 3]).unbind(-1)
    column, row = across / depth, down / depth
    shown = (row >= 0) & (row < len(near)) & (column >= 0) & (column < near.shape[1])
    row, column = (torch.where(shown, pixel, 0).long() for pixel in (row, column))
    return shown & ~near[row, column]


def inside(corners: Tensor, batch: Mapping[str, Tensor], sample: int) -> Tensor:
    """Whether shapes with corners (n, k, 3), faces or points, are inside the visual hull, by these and their centres,
    (n,); all if none is: then the silhouette is of something else."""
    places = torch.cat([corners, corners.mean(dim=1, keepdim=True)], dim=1)
    found = ~outside(places, batch, sample).any(dim=1)
    return found | ~found.any()
