"""Run time of the operations on charts, compared with alternatives.

    python -m studies.benchmarks.charts [--only aggregate | chamfer] [--threads 2]

Sums over neighbourhoods and Chamfer distances, each compared with alternatives in alternating runs. Clouds are those
of a dataset. Times are medians: of processor time with one thread (hardly affected by other load), of wall time with
several. Fits of touch charts, and the error of a Chamfer distance by its points, are in the report of error against
run time (`studies`).
"""

import argparse
import time
from collections.abc import Callable

import numpy as np
import pandas as pd
import torch
from scipy.spatial import cKDTree
from torch import Tensor
from torch.nn import functional

import palpate
from palpate.charts import (
    Graph,
    build_tree,
    chamfer_distance,
    sample_faces,
    vision_atlas,
)
from palpate.charts.atlas import CHART_VERTICES, TOUCH_VERTICES, VISION_CHARTS
from palpate.charts.chamfer import nearest_in_blocks
from studies.timing import interleaved


def medians(methods: dict[str, Callable[[], object]], runs: int) -> dict[str, float]:
    """Milliseconds of each method; their runs alternate, so that conditions are the same for all."""
    clock = time.process_time if torch.get_num_threads() == 1 else time.perf_counter
    return {name: round(1e3 * spent.seconds, 3) for name, spent in interleaved(methods, runs, clock=clock).items()}


def sums(graph: Graph) -> dict[str, Callable[[Tensor], Tensor]]:
    """Methods to apply the normalised adjacency to features (V, n), all with the same result."""
    vertices, touches = graph.vertices, graph.touch_charts
    start, neighbour, weight = graph.start, graph.neighbour, graph.weight.float()
    left, dense = graph.left.float(), graph.dense().float()
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

    def weighted_rows(x: Tensor) -> Tensor:
        y = functional.embedding_bag(
            neighbour, x, start, mode="sum", per_sample_weights=weight, include_last_offset=True
        )
        return block(x, y)

    return {
        "dense": lambda x: dense @ x,
        "padded gather": lambda x: block(x, (x[padded] * padded_weight[..., None]).sum(dim=1)),
        "index_add": lambda x: block(x, torch.zeros_like(x).index_add_(0, row, x[neighbour] * weight[:, None])),
        "dense blocks": blocks,
        "sparse CSR": lambda x: block(x, sparse @ x),
        "embedding_bag": weighted_rows,
    }


def aggregate(runs: int) -> pd.DataFrame:
    """One sum over neighbourhoods, forward; then with autograd, forward and backward."""
    rows = []
    for grasps, batch, channels in ((1, 2, 22), (1, 2, 84), (1, 8, 22), (1, 16, 84), (5, 8, 84)):
        graph = Graph(4 * grasps)
        x = torch.rand(graph.vertices, batch * channels)
        methods = sums(graph)
        expected = methods["dense"](x)
        for way in methods.values():
            torch.testing.assert_close(way(x), expected, rtol=1e-4, atol=1e-5)
        timed = {name: lambda way=way, x=x: way(x) for name, way in methods.items()}
        features = x.view(graph.vertices, batch, channels).requires_grad_()
        adjacency = graph.dense().float()
        gradient = torch.rand(features.shape)

        def aggregate_gradient(graph=graph, features=features, gradient=gradient):
            return torch.autograd.grad(graph.aggregate(features), features, gradient)

        def dense_gradient(adjacency=adjacency, features=features, gradient=gradient):
            y = (adjacency @ features.flatten(1)).view_as(features)
            return torch.autograd.grad(y, features, gradient)

        timed |= {"dense, both passes": dense_gradient, "aggregate, both passes": aggregate_gradient}
        rows.append({"V": graph.vertices, "B": batch, "C": channels, **medians(timed, runs)})
    return pd.DataFrame(rows)


def predictions(points: np.ndarray, random: np.random.Generator) -> dict[str, np.ndarray]:
    """Predicted points of a training step: on the atlas at first, near the surface in the end."""
    atlas = vision_atlas()
    seeded = torch.Generator().manual_seed(0)
    first = sample_faces(atlas.vertices[None], atlas.faces, len(points), seeded)[0].numpy()
    noise = random.normal(scale=0.01, size=points.shape)
    return {"atlas": first, "near": (random.permutation(points) + noise).astype(np.float32)}


def chamfer(dataset: palpate.Dataset, runs: int) -> pd.DataFrame:
    """Both directions between a prediction and an object's surface, trees included; mean over objects."""
    random = np.random.default_rng(0)
    surface = dataset.array("surface", "points")
    subsample = random.choice(len(surface), 8, replace=False)
    rows = []
    for n in (1500, 10000):
        for stage in ("atlas", "near"):
            found = []
            for index in subsample:
                truth = np.asarray(surface[int(index)])[:n]
                predicted = predictions(truth, random)[stage]
                p, q = torch.from_numpy(predicted), torch.from_numpy(truth)
                tree = build_tree(q)
                methods: dict[str, Callable[[], object]] = {
                    "all pairs": lambda p=p, q=q: [pairs.min(dim=1) for d in [torch.cdist(p, q)] for pairs in (d, d.T)],
                    "blocks": lambda p=p, q=q: (nearest_in_blocks(p, q), nearest_in_blocks(q, p)),
                    "tree, library's defaults": lambda p=p, q=q: (cKDTree(q).query(p), cKDTree(p).query(q)),
                }
                for leaf in (16, 32, 64, 128):
                    methods[f"tree, leaf {leaf}"] = lambda p=p, q=q, leaf=leaf: [
                        cKDTree(b, leafsize=leaf, balanced_tree=False, compact_nodes=False).query(a)
                        for a, b in ((p, q), (q, p))
                    ]
                methods["chamfer_distance"] = lambda p=p, q=q: chamfer_distance([p], [q])
                methods["chamfer_distance, tree kept"] = lambda p=p, q=q, tree=tree: chamfer_distance(
                    [p], [q], b_trees=[tree]
                )
                found.append(medians(methods, 1 if n > 5000 else runs))
            rows.append({"points": n, "prediction": stage, **pd.DataFrame(found).mean().round(2)})
    return pd.DataFrame(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", choices=["aggregate", "chamfer"])
    parser.add_argument("--run", default="results/default", help="folder of the dataset")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--runs", type=int, default=15)
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    dataset = None if arguments.only == "aggregate" else palpate.Dataset(arguments.run)
    tables = {
        "aggregate": lambda: aggregate(arguments.runs).set_index(["V", "B", "C"]).T,
        "chamfer": lambda: chamfer(dataset, arguments.runs).set_index(["points", "prediction"]).T,
    }
    for name in [arguments.only] if arguments.only else tables:
        print(f"\n{name}, ms, {arguments.threads} thread(s)\n{tables[name]().to_string()}", flush=True)


if __name__ == "__main__":
    main()
