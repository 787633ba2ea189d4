"""The fused zero-neighbour layer against the plain one with a dense adjacency, forward and backward."""

import math

import pytest
import torch

from palpate.architectures import GCN
from palpate.charts import Graph
from palpate.models.gcn import GraphNetwork, ZeroNeighbourLayer
from tests.models.straightforward import dense_adjacency


def plain_layer(layer, x, adjacency):
    """The published layer's order of things: product, first third over neighbours, join, bias, ReLU."""
    y = torch.einsum("vbi,io->vbo", x, layer.weight)
    last = layer.slope is None
    third = layer.weight.shape[1] if last else layer.weight.shape[1] // 3  # all channels of the last layer
    y = torch.cat([torch.einsum("uv,vbo->ubo", adjacency, y[..., :third]), y[..., third:]], dim=-1)
    y = y + layer.bias
    return y if last else torch.where(y > 0, y, layer.slope * y)


@pytest.mark.parametrize("normalisation", ["symmetric", "mean"])
@pytest.mark.parametrize("kind", ["charts", "sphere"])
@pytest.mark.parametrize(
    ("samples", "inputs", "outputs", "relu", "slope"),
    [(1, 5, 7, True, 0.0), (3, 4, 3, False, 0.1), (2, 1, 2, True, 0.1)],
)
def test_layer_is_the_plain_one(kind, normalisation, samples, inputs, outputs, relu, slope):
    torch.manual_seed(0)
    graph = Graph(3 if kind == "charts" else 0, kind, normalisation)
    layer = ZeroNeighbourLayer(inputs, outputs, relu, slope=slope).double()
    layer.initialise("paper")
    x = torch.randn(graph.vertices, samples, inputs, dtype=torch.float64, requires_grad=True)
    direction = torch.randn(graph.vertices, samples, outputs, dtype=torch.float64)
    given = direction.clone()
    wanted = (x, layer.weight, layer.bias)
    fast = layer(x, graph)
    of_fast = torch.autograd.grad(fast, wanted, direction)
    slow = plain_layer(layer, x, dense_adjacency(graph))
    of_slow = torch.autograd.grad(slow, wanted, direction)
    torch.testing.assert_close(fast, slow, rtol=1e-12, atol=1e-12)
    torch.testing.assert_close(of_fast, of_slow, rtol=1e-11, atol=1e-10)
    assert torch.equal(direction, given)  # The gradient that comes in belongs to someone else.


def test_gradients_by_finite_differences():
    torch.manual_seed(0)
    graph = Graph(2)
    layer = ZeroNeighbourLayer(3, 6).double()
    x = torch.randn(graph.vertices, 2, 3, dtype=torch.float64, requires_grad=True)

    def output(x, weight, bias):
        return torch.func.functional_call(layer, {"weight": weight, "bias": bias}, (x, graph))

    weight, bias = (p.detach().clone().requires_grad_() for p in layer.parameters())
    assert torch.autograd.gradcheck(output, (x, weight, bias), fast_mode=True)


def test_network_is_its_layers_in_a_row():
    torch.manual_seed(0)
    graph = Graph(1)
    network = GraphNetwork(4, GCN(4, 9, slope=0.1)).double()
    x = torch.randn(graph.vertices, 2, 4, dtype=torch.float64)
    expected = x
    for layer in network.layers:
        expected = plain_layer(layer, expected, dense_adjacency(graph))
    torch.testing.assert_close(network(x, graph), expected, rtol=1e-12, atol=1e-14)
    assert [layer.slope for layer in network.layers] == [0.1, 0.1, 0.1, None]
    assert (expected < 0).any()


def test_initial_weights():
    torch.manual_seed(0)
    layer = ZeroNeighbourLayer(400, 300).requires_grad_(False)
    layer.initialise("he")
    assert layer.weight.std() == pytest.approx(math.sqrt(2 / 400), rel=0.02)
    assert not layer.bias.any()
    layer.initialise("he", scale=0.01)
    assert layer.weight.std() == pytest.approx(0.01 * math.sqrt(2 / 400), rel=0.02)
    layer.initialise("paper")
    # The published code: uniform within 0.3 x 6 / sqrt(inputs + 1), biases within 0.1.
    assert 0.99 * 1.8 / math.sqrt(401) < layer.weight.abs().max() <= 1.8 / math.sqrt(401)
    assert 0.09 < layer.bias.abs().max() <= 0.1
    with pytest.raises(ValueError, match="init 'xavier'"):
        layer.initialise("xavier")


def test_he_keeps_the_size_of_features_over_many_layers():
    torch.manual_seed(0)
    graph = Graph(4)
    network = GraphNetwork(32, GCN(21, 120), "he", last_layer_scale=1.0)
    with torch.no_grad():
        sizes = []
        x = torch.randn(graph.vertices, 1, 32)
        for layer in network.layers[:-1]:
            x = layer(x, graph)
            sizes.append(x.square().mean())
    assert 0.05 < sizes[-1] / sizes[0] < 20


@pytest.mark.parametrize(("layers", "width"), [(0, 10), (3, 2)])
def test_impossible_networks(layers, width):
    with pytest.raises(ValueError, match="at least 1 layer"):
        GraphNetwork(3, GCN(layers, width))
