"""The graph network that moves the vertices: zero-neighbour layers, layout (vertex, sample, channel)."""

import math
from itertools import pairwise
from typing import Any

import torch
from torch import Tensor, nn
from torch.autograd.function import once_differentiable

from palpate.architectures import GCN
from palpate.charts.graph import Graph


class ZeroNeighbour(torch.autograd.Function):
    """relu(A(X W + P) + b), where A sums the first `shared` channels over neighbourhoods, in few passes. P, or None,
    are the products of other inputs with their weights. One matrix product with the bias or P in it, then the shared
    channels and the ReLU in place: the plain layer (tests/models/test_gcn.py), faster (docs/evidence/models.md)."""

    @staticmethod
    def forward(
        ctx: Any,
        x: Tensor,
        weight: Tensor,
        bias: Tensor,
        products: Tensor | None,
        graph: Graph,
        shared: int,
        slope: float | None,
    ) -> Tensor:
        """What the class says; slope: of the ReLU below 0, or None without one."""
        rows = x.flatten(0, 1)
        if products is None:
            late = bias.clone()  # The bias of the shared channels comes after the sum.
            late[:shared] = 0
            y = torch.addmm(late, rows, weight).view(*x.shape[:2], -1)
        else:
            y = torch.addmm(products.flatten(0, 1), rows, weight).view(*x.shape[:2], -1)
            y[..., shared:] += bias[shared:]
        if shared:
            y[..., :shared] = graph.aggregate(y[..., :shared]).add_(bias[:shared])
        if slope is not None:
            torch.nn.functional.leaky_relu_(y, slope)
        ctx.save_for_backward(x, weight, None if slope is None else y)
        ctx.graph, ctx.shared, ctx.slope = graph, shared, slope
        return y

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        x, weight, y = ctx.saved_tensors
        # A copy either way: what comes in must not be changed in place.
        through = torch.ops.aten.leaky_relu_backward
        gradient = gradient.clone() if y is None else through(gradient, y, ctx.slope, True)
        grad_bias = gradient.sum(dim=(0, 1))
        if ctx.shared:
            shared = gradient[..., : ctx.shared]
            gradient[..., : ctx.shared] = ctx.graph.aggregate(shared, transpose=True)
        rows = gradient.flatten(0, 1)
        grad_x = (rows @ weight.T).view(x.shape) if ctx.needs_input_grad[0] else None
        grad_products = gradient if ctx.needs_input_grad[3] else None
        return grad_x, x.flatten(0, 1).T @ rows, grad_bias, grad_products, None, None, None


@torch.no_grad()
def initialise(weight: Tensor, init: str, scale: float = 1.0, fan_in: int | None = None) -> None:
    """Fill weights (inputs, outputs) with random numbers, times `scale`. init: `he`, normal of variance 2 / fan_in, or
    `paper`, the published code's uniform ones; ValueError for others. fan_in: inputs; None: all rows."""
    inputs = fan_in or len(weight)
    if init == "he":
        weight.normal_(std=math.sqrt(2 / inputs))
    elif init == "paper":
        bound = 1.8 / math.sqrt(inputs + 1)
        weight.uniform_(-bound, bound)
    else:
        raise ValueError(f"init {init!r}: choose one of paper, he")
    weight.mul_(scale)


class ZeroNeighbourLayer(nn.Module):
    """X W; the first third of the output channels, or all, summed over the neighbourhood; bias; ReLU (the published
    code; GEOMetrics). The last layer of a network has relu False, and sums `shared` of its channels, the coordinates
    (the published code: all 3; its first release: 1). slope: of the ReLU below 0."""

    def __init__(self, inputs: int, outputs: int, relu: bool = True, shared: int = 3, slope: float = 0.0):
        super().__init__()
        self.weight = nn.Parameter(torch.empty(inputs, outputs))
        self.bias = nn.Parameter(torch.empty(outputs))
        self.shared = outputs // 3 if relu else shared
        self.slope = slope if relu else None
        self.initialise("he")

    def initialise(self, init: str, scale: float = 1.0, fan_in: int | None = None) -> None:
        """Random weights as `initialise` makes them, and a bias: 0 for `he`, else the published code's."""
        initialise(self.weight, init, scale, fan_in)
        with torch.no_grad():
            self.bias.zero_() if init == "he" else self.bias.uniform_(-0.1, 0.1)

    def forward(self, x: Tensor, graph: Graph, products: Tensor | None = None) -> Tensor:
        """(V, B, inputs) -> (V, B, outputs). products: (V, B, outputs) of further inputs with their weights."""
        tensors = [x, self.weight, self.bias, products]
        device = x.device.type
        if torch.is_autocast_enabled(device):
            tensors = [tensor if tensor is None else tensor.to(torch.get_autocast_dtype(device)) for tensor in tensors]
        with torch.autocast(device, enabled=False):
            return ZeroNeighbour.apply(*tensors, graph, self.shared, self.slope)


class GraphNetwork(nn.Module):
    """The zero-neighbour layers that `options` has; the last gives the 3 coordinates of a residual. init: see
    `initialise`. last_layer_scale: of its weights. fan_in: inputs of the first layer, with those that come as products.
    outputs: of the first layer."""

    def __init__(
        self, inputs: int, options: GCN, init: str = "he", last_layer_scale: float = 0.01, fan_in: int | None = None
    ):
        super().__init__()
        layers, width = options.layers, options.width
        if layers < 1 or width < 3:
            raise ValueError(f"gcn: {layers} layers of width {width}: at least 1 layer, of width 3")
        widths = [inputs, *[width] * (layers - 1), 3]
        sizes = enumerate(pairwise(widths))
        own = options.shared_coordinates, options.slope
        built = [ZeroNeighbourLayer(*size, k < layers - 1, *own) for k, size in sizes]
        for k, layer in enumerate(built):
            layer.initialise(init, last_layer_scale if k == layers - 1 else 1.0, None if k else fan_in)
        self.outputs, self.layers = widths[1], nn.ModuleList(built)

    def forward(self, x: Tensor, graph: Graph, products: Tensor | None = None) -> Tensor:
        """(V, B, inputs) -> (V, B, 3); products: see `ZeroNeighbourLayer.forward`, of the first layer."""
        x = self.layers[0](x, graph, products)
        for layer in self.layers[1:]:
            x = layer(x, graph)
        return x
