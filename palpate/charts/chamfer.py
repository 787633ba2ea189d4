"""The Chamfer distance between point clouds, by exact nearest neighbours.

On a CPU neighbours are found with k-d trees; on a GPU by a search over blocks of queries, which never holds
all pairs. Gradients flow through the pairs that were found.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import torch
from scipy.spatial import cKDTree
from torch import Tensor

BLOCK_PAIRS = 1 << 24  # pairs of a query and a point held at a time on a GPU: 64 MiB of float32 distances
LEAF_SIZE = 64  # points in a leaf of a k-d tree, chosen in docs/charts.md

Clouds = Tensor | Sequence[Tensor]


def checked(points: Tensor) -> Tensor:
    """The cloud (n, 3), detached. Raises ValueError for another shape, no point, NaN or infinity."""
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"a point cloud of shape {tuple(points.shape)}; must be (n, 3)")
    if not len(points):
        raise ValueError("an empty point cloud has no nearest neighbours; omit it")
    if not torch.isfinite(points).all():
        raise ValueError("a point cloud holds NaN or infinity")
    return points.detach()


def build_tree(points: Tensor) -> cKDTree:
    """A k-d tree of a cloud (n, 3), to be built once for a cloud that does not change."""
    # Cells split in the middle, large leaves: a search between clouds far apart, as early in training, takes
    # half the time or less of one with the library's defaults (docs/charts.md).
    cloud = checked(points).cpu().double().numpy()
    return cKDTree(cloud, leafsize=LEAF_SIZE, balanced_tree=False, compact_nodes=False)


def nearest_in_blocks(query: Tensor, points: Tensor, pairs: int = BLOCK_PAIRS) -> Tensor:
    """`nearest` by looking at all pairs, at most `pairs` (or one query's) at a time."""
    rows = max(1, pairs // len(points))
    found = [
        torch.cdist(block, points, compute_mode="donot_use_mm_for_euclid_dist").argmin(dim=1)
        for block in query.split(rows)
    ]
    return torch.cat(found)


def nearest_in_tree(query: Tensor, tree: cKDTree, workers: int) -> Tensor:
    """`nearest` by a k-d tree of the points."""
    _, index = tree.query(query.cpu().double().numpy(), workers=workers)
    return torch.from_numpy(index).to(query.device)


def nearest(query: Tensor, points: Tensor, tree: cKDTree | None = None) -> Tensor:
    """Which point lies nearest to each query, exactly.

    Args:
        query: (n, 3), points: (m, 3), on one device.
        tree: `build_tree(points)` if it is there already; used on a CPU only.

    Returns: (n,) int64.

    Raises ValueError if a cloud is empty or holds NaN or infinity.
    """
    query = checked(query)
    if query.device.type != "cpu":
        return nearest_in_blocks(query, checked(points))
    return nearest_in_tree(query, tree or build_tree(points), torch.get_num_threads())


def nearest_of_all(jobs: Sequence[tuple[Tensor, Tensor, cKDTree | None]]) -> list[Tensor]:
    """`nearest` of many (query, points, tree); on a CPU in several threads, which also build trees in parallel."""
    workers = min(torch.get_num_threads(), len(jobs))
    if workers < 2 or jobs[0][0].device.type != "cpu":
        return [nearest(*job) for job in jobs]

    def search(job: tuple[Tensor, Tensor, cKDTree | None]) -> Tensor:
        query, points, tree = job
        return nearest_in_tree(checked(query), tree or build_tree(points), workers=1)

    with ThreadPoolExecutor(workers) as pool:
        return list(pool.map(search, jobs))


def mean_squared(query: Tensor, points: Tensor, index: Tensor) -> Tensor:
    """Mean squared distance of each query (n, 3) to the point (m, 3) that `index` (n,) names.

    In float32 at least: in float16 the squares of distances below 0.2 mm are 0.
    """
    dtype = torch.promote_types(query.dtype, torch.float32)
    return (query.to(dtype) - points.to(dtype)[index]).square().sum(dim=1).mean()


def paired(a: Clouds, b: Clouds) -> None:
    """Raises ValueError unless a and b have the same number of clouds, at least one."""
    if len(a) != len(b) or not len(a):
        raise ValueError(f"{len(a)} clouds against {len(b)}; must be as many, and at least one")


def one_sided_distance(query: Clouds, points: Clouds, trees: Sequence[cKDTree] | None = None) -> Tensor:
    """Mean squared distance from each query to the nearest point, for each pair of clouds.

    Args:
        query, points: (B, n, 3) and (B, m, 3) metres, or sequences of B clouds (n_i, 3) and (m_i, 3).
        trees: `build_tree` of each cloud of points, if they are there already; used on a CPU only.

    Returns: (B,) square metres, float32 for clouds of less; times `palpate.protocol.CHAMFER_SCALE` in the tables' unit.
    Differentiable in both clouds.

    Raises ValueError if a cloud is empty or holds NaN or infinity, or the numbers of clouds differ.
    """
    paired(query, points)
    trees = trees or [None] * len(query)
    index = nearest_of_all(list(zip(query, points, trees, strict=True)))
    return torch.stack([mean_squared(*pair) for pair in zip(query, points, index, strict=True)])


def chamfer_distance(
    a: Clouds, b: Clouds, a_trees: Sequence[cKDTree] | None = None, b_trees: Sequence[cKDTree] | None = None
) -> Tensor:
    """Chamfer distance of each pair of clouds: mean squared distance from a to b, plus that from b to a
    (paper, equation 2, with means for sums, as in its tables).

    Args:
        a, b: (B, n, 3) and (B, m, 3) metres, or sequences of B clouds (n_i, 3) and (m_i, 3).
        a_trees, b_trees: `build_tree` of each cloud, of those that do not change; used on a CPU only.

    Returns: (B,) square metres, float32 for clouds of less; times `palpate.protocol.CHAMFER_SCALE` in the tables' unit.
    Differentiable in both clouds.

    Raises ValueError if a cloud is empty or holds NaN or infinity, or the numbers of clouds differ.
    """
    paired(a, b)
    forth = zip(a, b, b_trees or [None] * len(b), strict=True)
    back = zip(b, a, a_trees or [None] * len(a), strict=True)
    index = nearest_of_all([*forth, *back])
    return torch.stack(
        [
            mean_squared(p, q, to_q) + mean_squared(q, p, to_p)
            for p, q, to_q, to_p in zip(a, b, index[: len(a)], index[len(a) :], strict=True)
        ]
    )
