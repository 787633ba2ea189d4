"""The Chamfer distance between point clouds, by exact nearest neighbours; gradients flow through the pairs found. On a
CPU by k-d trees; on a GPU by blocks of queries, which never hold all pairs."""

from collections.abc import Sequence

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

BLOCK_PAIRS = 1 << 24  # pairs of a query and a point held at a time on a GPU: 64 MiB of float32 distances
PLANE_POINTS = 16  # of a plane through the surface: 10,000 points on 0.2 m^2 then have planes 1 cm wide
LEAF_SIZE = 64  # points in a leaf of a k-d tree, chosen in docs/evidence/error_vs_runtime.md

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
    # Cells split in the middle, large leaves: between clouds far apart, as early in training, a search takes half the
    # time or less of one with the library's defaults (docs/evidence/error_vs_runtime.md).
    cloud = checked(points).cpu().double().numpy()
    return cKDTree(cloud, leafsize=LEAF_SIZE, balanced_tree=False, compact_nodes=False)


def nearest_in_blocks(query: Tensor, points: Tensor, pairs: int = BLOCK_PAIRS) -> Tensor:
    """`nearest` by looking at all pairs, at most `pairs` (or one query's) at a time."""
    rows = max(1, pairs // len(points))
    nearest_rows = [
        torch.cdist(block, points, compute_mode="donot_use_mm_for_euclid_dist").argmin(dim=1)
        for block in query.split(rows)
    ]
    return torch.cat(nearest_rows)


def nearest(query: Tensor, points: Tensor, tree: cKDTree | None = None) -> Tensor:
    """Which point (m, 3) lies nearest to each query (n, 3), exactly: (n,) int64. tree: `build_tree(points)`, used on a
    CPU only. Raises ValueError if a cloud is empty or holds NaN or infinity."""
    query = checked(query)
    if query.device.type != "cpu":
        return nearest_in_blocks(query, checked(points))
    _, index = (tree or build_tree(points)).query(query.double().numpy(), workers=torch.get_num_threads())
    return torch.from_numpy(index)


def one_sided_distance(query: Clouds, points: Clouds, trees: Sequence[cKDTree] | None = None) -> Tensor:
    """Mean squared distance (B,) m^2 from each query to the nearest point, for each pair of clouds; differentiable, in
    float32 at least. query, points: (B, n, 3) and (B, m, 3) metres, or sequences of B clouds. trees: of the points,
    used on a CPU only. Raises ValueError if a cloud is empty, NaN or infinite, or their numbers differ."""
    if len(query) != len(points) or not len(query):
        raise ValueError(f"{len(query)} clouds against {len(points)}; must be as many, and at least one")
    distances = []
    for cloud, others, tree in zip(query, points, trees or [None] * len(query), strict=True):
        dtype = torch.promote_types(cloud.dtype, torch.float32)  # In float16 squares of less than 0.2 mm are 0.
        met = others.to(dtype)[nearest(cloud, others, tree)]
        distances.append((cloud.to(dtype) - met).square().sum(dim=1).mean())
    return torch.stack(distances)


def chamfer_distance(
    a: Clouds, b: Clouds, a_trees: Sequence[cKDTree] | None = None, b_trees: Sequence[cKDTree] | None = None
) -> Tensor:
    """Chamfer distance of each pair of clouds: `one_sided_distance` from a to b, plus that from b to a
    (paper, equation 2, with means for sums, as in its tables). Raises what that raises."""
    return one_sided_distance(a, b, b_trees) + one_sided_distance(b, a, a_trees)


def plane_normals(points: np.ndarray, tree: cKDTree) -> np.ndarray:
    """Unit normals (n, 3), of either sign, of the planes around points (n, 3) that fit a cloud best: through its
    nearest `PLANE_POINTS` (Hoppe et al. 1992, Surface Reconstruction from Unorganized Points). tree: of the cloud."""
    _, near = tree.query(points, k=min(PLANE_POINTS, tree.n))
    around = tree.data[near]
    around = around - around.mean(axis=1, keepdims=True)
    _, axes = np.linalg.eigh(np.swapaxes(around, 1, 2) @ around)
    return axes[:, :, 0]  # eigenvalues rise: the direction in which the points spread least
