"""Layers shared by the networks."""

import torch
from torch import nn

NORMS = {"batch": nn.BatchNorm2d, "instance": lambda channels: nn.InstanceNorm2d(channels, affine=True)}


class ConvolutionBlock(nn.Sequential):
    """A row of the paper's tables: convolution, normalisation (`norm`: batch or instance), ReLU.

    (B, inputs, H, W) -> (B, outputs, H', W') with H' = (H + 2 padding - kernel) // stride + 1. The
    convolution has no bias, because normalisation would remove it.
    """

    def __init__(self, inputs: int, outputs: int, kernel=3, stride=1, padding=0, norm="batch"):
        if norm not in NORMS:
            raise ValueError(f"norm {norm!r}: choose one of {sorted(NORMS)}")
        super().__init__(
            nn.Conv2d(inputs, outputs, kernel, stride, padding, bias=False),
            NORMS[norm](outputs),
            nn.ReLU(inplace=True),
        )


class Concatenate(nn.Module):
    """Concatenates tensors along `dim`; a module, so that hooks can observe it."""

    def __init__(self, dim: int):
        super().__init__()
        self.dim = dim

    def forward(self, *tensors: torch.Tensor) -> torch.Tensor:
        return torch.cat(tensors, dim=self.dim)


class LinearBlock(nn.Sequential):
    """Linear layer and ReLU over the last axis."""

    def __init__(self, inputs: int, outputs: int):
        super().__init__(nn.Linear(inputs, outputs), nn.ReLU())
