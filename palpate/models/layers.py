"""Layers shared by the networks."""

from collections.abc import Callable

from torch import nn

NORMS: dict[str, Callable[[int], nn.Module]] = {
    "batch": nn.BatchNorm2d,
    # A group for each channel. torch's own instance norm is the same, and copies maps on a CPU.
    "instance": lambda channels: nn.GroupNorm(channels, channels),
    "none": lambda channels: nn.Identity(),
}


class ConvolutionBlock(nn.Sequential):
    """A row of the paper's tables: convolution, normalisation (`norm`: batch, instance or none), ReLU.
    (B, inputs, H, W) -> (B, outputs, H', W') with H' = (H + 2 padding - kernel) // stride + 1. The convolution has a
    bias only without normalisation, which would remove it; its weights then keep the size of features
    (He et al. 2015)."""

    def __init__(
        self, inputs: int, outputs: int, kernel: int = 3, stride: int = 1, padding: int = 0, norm: str = "batch"
    ):
        if norm not in NORMS:
            raise ValueError(f"norm {norm!r}: choose one of {sorted(NORMS)}")
        convolution = nn.Conv2d(inputs, outputs, kernel, stride, padding, bias=norm == "none")
        if convolution.bias is not None:
            nn.init.kaiming_normal_(convolution.weight, nonlinearity="relu")
            nn.init.zeros_(convolution.bias)
        super().__init__(convolution, NORMS[norm](outputs), nn.ReLU(inplace=True))


class LinearBlock(nn.Sequential):
    """Linear layer and ReLU over the last axis."""

    def __init__(self, inputs: int, outputs: int):
        super().__init__(nn.Linear(inputs, outputs), nn.ReLU())
