"""Layers shared by the networks."""

import torch
from torch import nn
from torch.nn import functional


class InstanceNorm(nn.InstanceNorm2d):
    """Instance norm with weights (Ulyanov et al. 2016): (B, channels, H, W), each map of each sample by itself.

    Of one sample it is a batch norm, which on a CPU takes a map in any layout; torch's instance norm copies it.
    """

    def __init__(self, channels: int):
        super().__init__(channels, affine=True)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        if len(x) > 1:
            return super().forward(x)
        return functional.batch_norm(x, None, None, self.weight, self.bias, training=True, eps=self.eps)


NORMS = {
    "batch": nn.BatchNorm2d,
    "instance": InstanceNorm,
    "none": lambda channels: nn.Identity(),
}


class ConvolutionBlock(nn.Sequential):
    """A row of the paper's tables: convolution, normalisation (`norm`: batch, instance or none), ReLU.

    (B, inputs, H, W) -> (B, outputs, H', W') with H' = (H + 2 padding - kernel) // stride + 1. The
    convolution has a bias only without normalisation, which would remove it; its weights then keep the size of
    features (He et al. 2015).
    """

    def __init__(self, inputs: int, outputs: int, kernel=3, stride=1, padding=0, norm="batch"):
        if norm not in NORMS:
            raise ValueError(f"norm {norm!r}: choose one of {sorted(NORMS)}")
        convolution = nn.Conv2d(inputs, outputs, kernel, stride, padding, bias=norm == "none")
        if norm == "none":
            nn.init.kaiming_normal_(convolution.weight, nonlinearity="relu")
            nn.init.zeros_(convolution.bias)
        super().__init__(convolution, NORMS[norm](outputs), nn.ReLU(inplace=True))


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
