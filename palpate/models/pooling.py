"""Perceptual feature pooling: the image's feature maps at the projection of each vertex."""

from collections.abc import Sequence

import torch
from torch import nn
from torch.nn import functional

ALIGNMENTS = ("extent", "receptive_field")
# Metres in front of the camera; nearer vertices, and those behind it, are taken as that far.
NEAR = 1e-3


def relative_camera(camera: torch.Tensor, size: int) -> torch.Tensor:
    """(..., 3, 4) world to homogeneous pixels of an image of `size` -> the same to [-1, 1] over the image."""
    scale = camera.new_tensor([[2 / size, 0, -1], [0, 2 / size, -1], [0, 0, 1]])
    return scale @ camera


class PerceptualPooling(nn.Module):
    """The features of each map at each vertex, by bilinear interpolation (supplement, "Chart Feature ...").

    Which cell of a map belongs to a place in the image is a matter of `alignment`:

    - `extent`: the map covers the image from edge to edge, its cells being equal squares (the paper: "the
      location of this projection ... corresponds exactly to a position in each feature map"). Cells of a
      network without padding look further inside than that.
    - `receptive_field`: the cell whose receptive field is centred there; needs `centres`, (first, step) of
      each map in pixels, from `ImageEncoder.centres`.

    Places outside the map take the value at its edge.
    """

    def __init__(self, alignment: str = "extent", centres: Sequence[tuple[float, int]] | None = None):
        super().__init__()
        if alignment not in ALIGNMENTS:
            raise ValueError(f"alignment {alignment!r}: choose one of {list(ALIGNMENTS)}")
        self.centres = centres if alignment == "receptive_field" else None

    def forward(
        self, maps: Sequence[torch.Tensor], positions: torch.Tensor, camera: torch.Tensor, size: int
    ) -> torch.Tensor:
        """Pooled features (V, B, sum of the maps' channels).

        maps: each (B, C, h, w), of images of `size` x `size` pixels. positions: (V, B, 3) in the world,
        metres. camera: (3, 4) or (B, 3, 4), from the world to homogeneous coordinates in [-1, 1] over the
        image, x to the right and y down (`relative_camera`).
        """
        turned = camera[..., :3].transpose(-1, -2)
        seen = (positions.transpose(0, 1) @ turned + camera[..., None, :, 3])[:, :, None]
        place = seen[..., :2] / seen[..., 2:].clamp(min=NEAR)
        pooled = []
        for k, features in enumerate(maps):
            grid = place
            if self.centres is not None:
                first, step = self.centres[k]
                cell = ((place + 1) * (size / 2) - first) / step
                grid = (2 * cell + 1) / features.shape[-1] - 1
            sampled = functional.grid_sample(features, grid, padding_mode="border", align_corners=False)
            pooled.append(sampled[..., 0])
        return torch.cat(pooled, dim=1).permute(2, 0, 1)
