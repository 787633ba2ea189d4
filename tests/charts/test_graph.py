"""The sum over neighbourhoods against the paper's equation over a networkx graph, and the dense matrix."""

import networkx
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.charts import Graph, sphere, touch_chart, vision_atlas
from tests.models.straightforward import dense_adjacency

CHARTS = Graph(4)
GRAPHS = [(0, "charts"), (4, "charts"), (20, "charts"), (4, "sphere")]


def networkx_graph(touch_charts, kind):
    """Vertices and edges as the paper describes them."""
    graph = networkx.Graph()
    faces = (sphere()[1] if kind == "sphere" else vision_atlas().faces).tolist()
    if kind == "charts":
        for start in range(1824, 1824 + 81 * touch_charts, 81):
            faces += (touch_chart().faces + start).tolist()
    for face in faces:
        networkx.add_cycle(graph, face)
    if kind != "sphere":
        graph.add_edges_from(vision_atlas().joined.tolist())
    if kind == "charts":
        for start in range(1824, 1824 + 81 * touch_charts, 81):
            graph.add_edges_from((start + 40, vertex) for vertex in vision_atlas().boundary.tolist())
    return graph


def equation_one(graph, x):
    """The paper's sum, vertex by vertex."""
    y = torch.zeros_like(x)
    for u in graph:
        for v in [u, *graph[u]]:
            y[u] += x[v] / ((len(graph[u]) + 1) * (len(graph[v]) + 1)) ** 0.5
    return y


def means(graph, x):
    """The mean over each vertex and its neighbours."""
    return torch.stack([x[[u, *graph[u]]].mean(dim=0) for u in sorted(graph)])


@pytest.mark.parametrize(("touch_charts", "kind"), GRAPHS)
def test_mean_is_the_neighbourhoods_mean(touch_charts, kind):
    graph = Graph(touch_charts, kind, "mean")
    x = torch.randn(graph.vertices, 2, 3, dtype=torch.float64)
    expected = means(networkx_graph(touch_charts, kind), x)
    torch.testing.assert_close(graph.aggregate(x), expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(("touch_charts", "kind"), GRAPHS)
def test_is_the_papers_sum(touch_charts, kind):
    graph = Graph(touch_charts, kind)
    other = networkx_graph(touch_charts, kind)
    assert graph.vertices == len(other)
    x = torch.randn(graph.vertices, 2, 3, dtype=torch.float64)
    torch.testing.assert_close(graph.aggregate(x), equation_one(other, x), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("normalisation", ["symmetric", "mean"])
@pytest.mark.parametrize(("touch_charts", "kind"), GRAPHS)
def test_agrees_with_the_dense_matrix_and_its_transpose(touch_charts, kind, normalisation):
    graph = Graph(touch_charts, kind, normalisation)
    dense = dense_adjacency(graph)
    x = torch.randn(graph.vertices, 2, 3, dtype=torch.float64)
    for matrix, transpose in ((dense, False), (dense.T, True)):
        expected = torch.einsum("uv,vbc->ubc", matrix, x)
        torch.testing.assert_close(graph.aggregate(x, transpose), expected, rtol=1e-12, atol=1e-12)


@settings(max_examples=15, deadline=None)
@given(batch=st.integers(1, 3), channels=st.integers(1, 9), seed=st.integers(0, 999))
def test_slices_and_transposed_inputs(batch, channels, seed):
    graph = CHARTS
    torch.manual_seed(seed)
    wide = torch.randn(batch, 3 * channels, graph.vertices).permute(2, 0, 1)
    x = wide[..., :channels]
    y = graph.aggregate(x)
    packed = x.clone(memory_format=torch.contiguous_format)
    torch.testing.assert_close(y, graph.aggregate(packed))
    assert y.is_contiguous()
    # An expanded tensor, as the gradient of a sum.
    ones = torch.ones(1).expand(x.shape)
    torch.testing.assert_close(graph.aggregate(ones), graph.aggregate(torch.ones_like(x)))


@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float32, 2e-6), (torch.bfloat16, 3e-2)])
def test_lower_precision(dtype, tolerance):
    graph = Graph(4)
    x = torch.randn(graph.vertices, 2, 3, dtype=torch.float64).to(dtype)
    y = graph.aggregate(x)
    assert y.dtype == dtype
    expected = torch.einsum("uv,vbc->ubc", dense_adjacency(graph), x.double())
    assert (y.double() - expected).abs().max() < tolerance * expected.abs().max()


def test_converting_the_module_keeps_working():
    graph = Graph(4).double().float()
    x = torch.randn(graph.vertices, 1, 2)
    torch.testing.assert_close(graph.aggregate(x), Graph(4).aggregate(x))
    assert not graph.state_dict()


def test_touch_reaches_every_chart_only_where_charts_communicate():
    graph = Graph(4)
    impulse = torch.zeros(graph.vertices, 1, 1)
    impulse[1824 + 40] = 1
    reached = graph.aggregate(impulse)[:, 0, 0].nonzero()[:, 0]
    assert set(vision_atlas().boundary.tolist()) < set(reached.tolist())


def test_bad_input():
    with pytest.raises(ValueError, match="must be charts or sphere"):
        Graph(4, "cube")
    with pytest.raises(ValueError, match="symmetric or mean"):
        Graph(4, normalisation="none")
    with pytest.raises(ValueError, match="0 or more"):
        Graph(-1)
    with pytest.raises(ValueError, match=r"must be \(2148"):
        Graph(4).aggregate(torch.zeros(1824, 2, 3))


def test_autocast_leaves_the_type_of_the_features():
    graph = Graph(4)
    x = torch.randn(graph.vertices, 2, 3, requires_grad=True)
    with torch.autocast("cpu", torch.bfloat16):
        y = graph.aggregate(x)
    torch.testing.assert_close(y, graph.aggregate(x))
    y.sum().backward()
    assert x.grad.dtype == torch.float32
