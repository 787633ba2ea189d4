"""The graph network that moves the vertices: zero-neighbour layers, layout (vertex, sample, channel)."""

import math

import torch
from torch import nn

from palpate.charts.graph import Graph

INITS = ("paper", "he")


class ZeroNeighbourLayer(nn.Module):
    """X W; the first third of the output channels summed over the neighbourhood; bias; ReLU.

    The graph operation is `Graph.aggregate`, the normalised sum of section 3's equation over a vertex and its
    neighbours. It works on `outputs // 3` channels only, the others pass (FACTS of the published code; a
    zero-neighbour layer is GEOMetrics'). relu: False for the last layer of a network.
    """

    def __init__(self, inputs: int, outputs: int, relu: bool = True):
        super().__init__()
        self.weight = nn.Parameter(torch.empty(inputs, outputs))
        self.bias = nn.Parameter(torch.empty(outputs))
        self.shared = outputs // 3
        self.relu = relu
        self.initialise("he")

    @torch.no_grad()
    def initialise(self, init: str, scale: float = 1.0) -> None:
        """`he`: normal of variance 2 / inputs, bias 0; `paper`: the published code's uniform numbers.

        The weights are then multiplied by `scale`.
        """
        if init == "he":
            self.weight.normal_(std=math.sqrt(2 / len(self.weight)))
            self.bias.zero_()
        elif init == "paper":
            bound = 1.8 / math.sqrt(len(self.weight) + 1)
            self.weight.uniform_(-bound, bound)
            self.bias.uniform_(-0.1, 0.1)
        else:
            raise ValueError(f"init {init!r}: choose one of {list(INITS)}")
        self.weight.mul_(scale)

    def forward(self, x: torch.Tensor, graph: Graph) -> torch.Tensor:
        """(V, B, inputs) -> (V, B, outputs)."""
        shared = graph.aggregate(x @ self.weight[:, : self.shared])
        x = torch.cat([shared, x @ self.weight[:, self.shared :]], dim=-1) + self.bias
        return torch.relu(x) if self.relu else x


class GraphNetwork(nn.Module):
    """`layers` zero-neighbour layers of `width` channels; the last gives the 3 coordinates of a residual.

    init, last_layer_scale: see `ZeroNeighbourLayer.initialise`; the scale is the last layer's weights'.
    """

    def __init__(
        self, inputs: int, width: int, layers: int, init: str = "he", last_layer_scale: float = 0.01
    ):
        super().__init__()
        if layers < 1 or width < 3:
            raise ValueError(f"gcn: {layers} layers of width {width}: at least 1 layer, of width 3")
        widths = [inputs, *[width] * (layers - 1), 3]
        self.layers = nn.ModuleList(
            ZeroNeighbourLayer(widths[k], widths[k + 1], relu=k < layers - 1) for k in range(layers)
        )
        for k, layer in enumerate(self.layers):
            layer.initialise(init, last_layer_scale if k == layers - 1 else 1.0)

    def forward(self, x: torch.Tensor, graph: Graph) -> torch.Tensor:
        """(V, B, inputs) -> (V, B, 3)."""
        for layer in self.layers:
            x = layer(x, graph)
        return x
