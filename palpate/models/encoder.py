"""Convolutional networks that turn images and touch readings into features."""

from collections.abc import Callable, Sequence

import torch
from torch import nn
from torch.nn import functional

from palpate.architectures import Encoder

KERNEL = 3
NORMS: dict[str, Callable[[int], nn.Module]] = {
    "batch": nn.BatchNorm2d,
    # A group for each channel. torch's own instance norm is the same, and copies maps on a CPU.
    "instance": lambda channels: nn.GroupNorm(channels, channels),
    "none": lambda channels: nn.Identity(),
}


class ConvolutionBlock(nn.Sequential):
    """A row of the paper's tables: convolution, normalisation (`norm`: batch, instance or none), ReLU. Without
    normalisation the convolution has a bias, and weights that keep the size of features (He et al. 2015)."""

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


class ImageEncoder(nn.Module):
    """The CNN whose intermediate feature maps are pooled at the vertices (supplement, "Model Architecture"). options:
    its layers; the first of a block has stride 2. Padding is 0 in the paper, 1 for single images."""

    def __init__(self, options: Encoder):
        super().__init__()
        channels, layers, pool = options.channels, options.layers, options.pool
        if len(channels) != len(layers) or not all(count > 0 for count in [*channels, *layers]):
            raise ValueError(f"encoder: channels {[*channels]} and layers {[*layers]} must be as many, and positive")
        total = sum(layers)
        if not pool or sorted(set(pool)) != list(pool) or pool[0] < 1 or pool[-1] > total:
            raise ValueError(f"encoder: pool {list(pool)} must rise within the layers 1 to {total}")
        if pool[-1] != total:
            raise ValueError(f"encoder: layers {pool[-1] + 1} to {total} are not used: pool {total}, or omit them")
        self.pool = tuple(pool)
        self.padding, self.downsample = options.padding, options.downsample
        self.strides = [2 if first else 1 for count in layers for first in [True] + [False] * (count - 1)]
        widths = [width for width, count in zip(channels, layers, strict=True) for _ in range(count)]
        self.layers = nn.ModuleList(
            ConvolutionBlock(inputs, outputs, KERNEL, stride, options.padding, options.norm)
            for inputs, outputs, stride in zip([3, *widths], widths, self.strides, strict=False)
        )
        self.channels = [widths[number - 1] for number in pool]

    def forward(self, image: torch.Tensor) -> list[torch.Tensor]:
        """(B, 3, H, W) image in [0, 1] -> the pooled layers' maps, each (B, channels, h, w). One image that is expanded
        to B samples (`Tensor.expand`) is encoded once."""
        if len(image) > 1 and image.stride(0) == 0:
            return [features.expand(len(image), -1, -1, -1) for features in self(image[:1])]
        image = image.contiguous()  # Pixel by pixel, torch's norms lose digits.
        if self.downsample > 1:
            image = functional.avg_pool2d(image, self.downsample)
        maps = []
        for number, layer in enumerate(self.layers, start=1):
            image = layer(image)
            if number in self.pool:
                maps.append(image)
        return maps

    def sizes(self, size: int) -> list[int]:
        """Edge of each pooled map, in cells, for an image `size` x `size`; ValueError if too small."""
        edges, edge = [], size // self.downsample
        for number, stride in enumerate(self.strides, start=1):
            edge = (edge + 2 * self.padding - KERNEL) // stride + 1
            if edge < 1:
                raise ValueError(
                    f"an image of {size} x {size} is too small for the encoder's {len(self.strides)} layers: "
                    f"nothing is left after layer {number}"
                )
            edges.append(edge)
        return [edges[number - 1] for number in self.pool]


class ReadingEncoder(nn.Module):
    """The simple CNN that makes features of a touch reading, for strategy `sphere` (section 5.1). The paper doesn't
    give its layers. Nothing is normalised: how much a reading differs from the empty one is its content."""

    def __init__(self, features: int = 32, channels: Sequence[int] = (16, 32, 64, 64)):
        super().__init__()
        self.features = features
        self.layers = nn.Sequential(
            *(
                ConvolutionBlock(inputs, outputs, stride=2, padding=1, norm="none")
                for inputs, outputs in zip((3, *channels), channels, strict=False)
            )
        )
        self.linear = nn.Linear(channels[-1], features)

    def forward(self, reading: torch.Tensor) -> torch.Tensor:
        """(N, 3, r, c) readings in [0, 1] -> (N, features)."""
        return torch.relu(self.linear(self.layers(reading).mean(dim=(2, 3))))
