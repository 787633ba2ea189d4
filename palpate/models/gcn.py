"""The graph network that moves the vertices: zero-neighbour layers, layout (vertex, sample, channel)."""

import math
from typing import Any

import torch
from torch import Tensor, nn
from torch.autograd.function import once_differentiable

from palpate.charts.graph import Graph

INITS = ("paper", "he")


class ZeroNeighbour(torch.autograd.Function):
    """relu(A(X W) + b), where A sums the first `shared` channels over neighbourhoods, in few passes.

    One matrix product with the bias in it, then the shared channels and the ReLU in place. Forward and
    backward are the plain layer's (tests/models/test_gcn.py); docs/models.md has the times of both.
    """

    @staticmethod
    def forward(ctx: Any, x: Tensor, weight: Tensor, bias: Tensor, graph: Graph, shared: int, relu: bool):
        late = bias.clone()  # The bias of the shared channels comes after the sum.
        late[:shared] = 0
        y = torch.addmm(late, x.flatten(0, 1), weight).view(*x.shape[:2], -1)
        if shared:
            y[..., :shared] = graph.aggregate(y[..., :shared]).add_(bias[:shared])
        if relu:
            y.relu_()
        ctx.save_for_backward(x, weight, y if relu else None)
        ctx.graph, ctx.shared = graph, shared
        return y

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor):
        x, weight, y = ctx.saved_tensors
        # A copy either way: what comes in must not be changed in place.
        through = torch.ops.aten.threshold_backward
        gradient = gradient.clone() if y is None else through(gradient, y, 0)
        of_bias = gradient.sum(dim=(0, 1))
        if ctx.shared:
            shared = gradient[..., : ctx.shared]
            gradient[..., : ctx.shared] = ctx.graph.aggregate(shared, transpose=True)
        rows = gradient.flatten(0, 1)
        of_x = (rows @ weight.T).view(x.shape) if ctx.needs_input_grad[0] else None
        return of_x, x.flatten(0, 1).T @ rows, of_bias, None, None, None


class ZeroNeighbourLayer(nn.Module):
    """X W; the first third of the output channels summed over the neighbourhood; bias; ReLU.

    The graph operation is `Graph.aggregate`, the normalised sum of section 3's equation over a vertex and its
    neighbours. It works on `outputs // 3` channels only, the others pass (the published code; a
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

    def forward(self, x: Tensor, graph: Graph) -> Tensor:
        """(V, B, inputs) -> (V, B, outputs)."""
        weight, bias = self.weight, self.bias
        device = x.device.type
        if torch.is_autocast_enabled(device):
            x, weight, bias = (tensor.to(torch.get_autocast_dtype(device)) for tensor in (x, weight, bias))
        with torch.autocast(device, enabled=False):
            return ZeroNeighbour.apply(x, weight, bias, graph, self.shared, self.relu)


class GraphNetwork(nn.Module):
    """`layers` zero-neighbour layers of `width` channels; the last gives the 3 coordinates of a residual.

    init, last_layer_scale: see `ZeroNeighbourLayer.initialise`; the scale is the last layer's weights'.
    """

    def __init__(self, inputs: int, width: int, layers: int, init: str = "he", last_layer_scale: float = 0.01):
        super().__init__()
        if layers < 1 or width < 3:
            raise ValueError(f"gcn: {layers} layers of width {width}: at least 1 layer, of width 3")
        widths = [inputs, *[width] * (layers - 1), 3]
        self.layers = nn.ModuleList(
            ZeroNeighbourLayer(widths[k], widths[k + 1], relu=k < layers - 1) for k in range(layers)
        )
        for k, layer in enumerate(self.layers):
            layer.initialise(init, last_layer_scale if k == layers - 1 else 1.0)

    def forward(self, x: Tensor, graph: Graph) -> Tensor:
        """(V, B, inputs) -> (V, B, 3)."""
        for layer in self.layers:
            x = layer(x, graph)
        return x
