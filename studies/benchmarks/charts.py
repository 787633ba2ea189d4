"""Run time of the sum over neighbourhoods in the graph of charts, beside other ways to take it.

    python -m studies.benchmarks.charts [--threads 2]

Methods take turns. Times are medians: of processor time with one thread (hardly affected by other load), of wall time
with several. Fits of touch charts, Chamfer distances and their search are in the report of error against run time.
"""

import argparse
import time
from collections.abc import Callable

import pandas as pd
import torch
from torch import Tensor
from torch.nn import functional

from palpate.charts import Graph, vision_atlas
from palpate.charts.atlas import CHART_VERTICES, TOUCH_VERTICES, VISION_CHARTS
from studies.benchmarks.straightforward import dense_adjacency
from studies.timing import interleaved

SIZES = ((1, 2, 22), (1, 2, 84), (1, 8, 22), (1, 16, 84), (5, 8, 84))  # grasps, batch, channels


def sums(graph: Graph) -> dict[str, Callable[[Tensor], Tensor]]:
    """Methods to apply the normalised adjacency to features (V, n), all with the same result."""
    vertices, touches = graph.vertices, graph.touch_charts
    start, neighbour, weight = graph.start, graph.neighbour, graph.weight.float()
    left, dense = graph.left.float(), dense_adjacency(graph).float()
    row = torch.arange(vertices).repeat_interleave(start.diff())
    sparse = torch.sparse_csr_tensor(start, neighbour, weight, (vertices, vertices))
    place = torch.arange(len(neighbour)) - start[:-1].repeat_interleave(start.diff())
    padded = torch.zeros(vertices, int(start.diff().max()), dtype=torch.long)
    padded_weight = torch.zeros(padded.shape)
    padded[row, place], padded_weight[row, place] = neighbour.long(), weight
    local = sparse.to_dense()
    n, vision = CHART_VERTICES, VISION_CHARTS * CHART_VERTICES
    charts = torch.stack([local[n * c : n * (c + 1), n * c : n * (c + 1)] for c in range(VISION_CHARTS)])
    touch = local[vision:, vision:][:TOUCH_VERTICES, :TOUCH_VERTICES]
    joined = torch.cat([vision_atlas().joined, vision_atlas().joined.flip(1)]).T
    joined_weight = local[joined[0], joined[1]][:, None]

    def block(x: Tensor, y: Tensor) -> Tensor:
        return y.addmm_(left.T, left.flip(0) @ x)

    def blocks(x: Tensor) -> Tensor:
        y = torch.empty_like(x)
        shape = (VISION_CHARTS, n, -1)
        torch.bmm(charts, x[:vision].view(shape), out=y[:vision].view(shape))
        shape = (touches, TOUCH_VERTICES, -1)
        torch.bmm(touch.expand(touches, -1, -1), x[vision:].view(shape), out=y[vision:].view(shape))
        return block(x, y.index_add_(0, joined[0], x[joined[1]] * joined_weight))

    bag = {"mode": "sum", "per_sample_weights": weight, "include_last_offset": True}
    return {
        "dense": lambda x: dense @ x,
        "padded gather": lambda x: block(x, (x[padded] * padded_weight[..., None]).sum(dim=1)),
        "index_add": lambda x: block(x, torch.zeros_like(x).index_add_(0, row, x[neighbour] * weight[:, None])),
        "dense blocks": blocks,
        "sparse CSR": lambda x: block(x, sparse @ x),
        "embedding_bag": lambda x: block(x, functional.embedding_bag(neighbour, x, start, **bag)),
    }


def both_passes(graph: Graph, features: Tensor) -> dict[str, Callable[[], object]]:
    """Forward and backward with autograd, of features (V, B, C)."""
    adjacency, gradient = dense_adjacency(graph).float(), torch.rand(features.shape)
    ways = {
        "dense, both passes": lambda: (adjacency @ features.flatten(1)).view_as(features),
        "aggregate, both passes": lambda: graph.aggregate(features),
    }
    return {name: lambda way=way: torch.autograd.grad(way(), features, gradient) for name, way in ways.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--runs", type=int, default=15)
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    clock, rows = time.process_time if args.threads == 1 else time.perf_counter, []
    for grasps, batch, channels in SIZES:
        graph = Graph(4 * grasps)
        x = torch.rand(graph.vertices, batch * channels)
        methods = sums(graph)
        for way in methods.values():
            torch.testing.assert_close(way(x), methods["dense"](x), rtol=1e-4, atol=1e-5)
        calls = {name: lambda way=way, x=x: way(x) for name, way in methods.items()}
        calls |= both_passes(graph, x.view(graph.vertices, batch, channels).requires_grad_())
        times = interleaved(calls, args.runs, clock=clock)
        spent = {name: round(1e3 * each.seconds, 3) for name, each in times.items()}
        rows.append({"V": graph.vertices, "B": batch, "C": channels, **spent})
    print(f"ms, {args.threads} thread(s)\n{pd.DataFrame(rows).set_index(['V', 'B', 'C']).T.to_string()}")


if __name__ == "__main__":
    main()
