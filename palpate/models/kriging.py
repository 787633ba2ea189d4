"""The correction of predictions at touched points: residuals there, interpolated by kriging (Gaussian processes).
The residual of a prediction is a Gaussian process of zero mean. Its covariance at distance r (m) is exp(-r / length),
in units of its variance. Its values at touched points are known but for noise, whose variance has the same unit."""

from collections.abc import Mapping

import igl
import numpy as np
import torch
from torch import Tensor

from palpate.charts import nearest
from palpate.experiments import Correction
from palpate.models.touch import chart_grid

LEAST_NOISE = 1e-6  # Without noise the equations of points that coincide have no solution.
BLOCK = 1 << 14  # queries at a time: 23 MB with the touched points of five grasps


class Kriging:
    """A residual known at some points, interpolated: `kriging(queries)` is its posterior mean (m, d) at (m, 3), metres.
    points: (n, 3) metres, n may be 0. values: (n, d) there. Differentiable in all; computed in float64."""

    def __init__(self, points: Tensor, values: Tensor, correction: Correction):
        self.points, self.length = points.double(), correction.length
        diagonal = torch.full_like(self.points[:, 0], max(correction.noise, LEAST_NOISE)).diag()
        self.factor = torch.linalg.cholesky(self._covariance(self.points) + diagonal)
        self.weights = torch.cholesky_solve(values.double(), self.factor)

    def __call__(self, queries: Tensor) -> Tensor:
        means = [self._covariance(block) @ self.weights for block in queries.double().split(BLOCK)]
        return torch.cat(means).to(queries.dtype)

    def variance(self, queries: Tensor) -> Tensor:
        """The posterior variance (m,) of the residual at queries (m, 3), of the one without touches: from 0 to 1."""
        variances = []
        for block in queries.double().split(BLOCK):
            known = torch.linalg.solve_triangular(self.factor, self._covariance(block).T, upper=False)
            variances.append(1 - known.square().sum(dim=0))
        return torch.cat(variances).clamp(min=0).to(queries.dtype)

    def _covariance(self, places: Tensor) -> Tensor:
        """(m, n) of the residual at places (m, 3) and at the points."""
        distance = torch.cdist(places, self.points, compute_mode="donot_use_mm_for_euclid_dist")
        return torch.exp(-distance / self.length)


def touched_points(batch: Mapping[str, Tensor]) -> list[Tensor]:
    """The known points (n, 3) of each sample of a batch, as `Reconstruction` takes it: 3 x 3 vertices of each
    successful touch chart. Charts without success are not read."""
    grid = chart_grid(batch["charts"])
    return [charts[touched].flatten(0, 1) for charts, touched in zip(grid, batch["success"].bool(), strict=True)]


def displaced(vertices: Tensor, faces: Tensor | None, touched: Tensor, correction: Correction) -> Tensor:
    """A predicted mesh's vertices (V, 3), m, moved by `Kriging` so that its surface meets touched points (n, 3): the
    nearest point of the surface to each is displaced to it. faces: (F, 3), or None for a cloud. The search has no
    gradient, which goes through barycentric coordinates. Without touched points, or if not finite, nothing moves."""
    if not len(touched) or not torch.isfinite(vertices).all():
        return vertices
    touched = touched.to(vertices.dtype)
    if faces is None:
        met = vertices[nearest(touched, vertices)]
    else:
        corners, weights = nearest_on_faces(touched, vertices, faces)
        # No product of matrices: in mixed precision it would be in 16 bits, which place a point to a millimetre.
        met = (weights[..., None] * vertices[corners]).sum(dim=1)
    return vertices + Kriging(met, touched - met, correction)(vertices)


def nearest_on_faces(points: Tensor, vertices: Tensor, faces: Tensor) -> tuple[Tensor, Tensor]:
    """Of the point of a mesh that is nearest to each point (n, 3): its face's vertices (n, 3), their weights (n, 3)."""
    query, mesh = (places.detach().cpu().double().numpy() for places in (points, vertices))
    corners = faces.cpu().numpy()
    _, index, met = igl.point_mesh_squared_distance(query, mesh, corners)
    corners = corners[index]
    weights = igl.barycentric_coordinates(met, *(mesh[corners[:, k]] for k in range(3)))
    weights = np.nan_to_num(weights, nan=1 / 3).clip(0, 1)  # of a face without area: its centre
    weights /= weights.sum(axis=1, keepdims=True)
    return torch.from_numpy(corners).to(faces.device), torch.from_numpy(weights).to(vertices)
