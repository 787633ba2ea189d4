"""Templates: fitted charts of training objects. A reconstruction begins with the mean of those that fit it best.

To retrieve an object and to deform it is known from meshes of CAD models (Uy et al. 2021, "Joint learning of 3D shape
retrieval and deformation").
"""

from collections.abc import Mapping
from functools import cached_property

import torch
from torch import Tensor, nn
from torch.nn import functional

from palpate.charts import sample_faces, sphere, vision_atlas
from palpate.charts.graph import mesh_edges
from palpate.experiments import Correction
from palpate.models.kriging import displaced, nearest_on_faces, touched_points
from palpate.models.retrieval import EXCLUDED, Objects

MASK = 64  # pixels along an edge of the silhouettes that are compared
POINTS = 5000  # on a template, to which touched points' distances are measured
SEARCHED = ("mask", "hand", "camera_number", "success", "charts", "excluded")  # keys of a batch
STARTS = 8  # templates whose mean a reconstruction begins with
SHARPNESS = 50.0  # of their weights: a fit that is better by 1 / SHARPNESS weighs e times as much
ENSEMBLE = 32  # templates whose differences say how a start may be wrong
NOISE = 0.02  # m, of a touched point's distance to the surface, beside these
ROUNDS = 3  # of looking for the face that is nearest to a touched point, and of conditioning
BENT = Correction(0.08, 0.03)  # of a start to the touched points
FORTH, BACK = 0.5, 1 / (1 / 0.5 - 0.1)  # the two steps of smoothing: a pass band of 0.1 (Taubin 1995)


class Templates(nn.Module):
    """The start of a reconstruction: `templates(batch)`, the mean of the templates that fit a sample best.

    It is `conditioned` by the touched points, and bent to them.

    All templates are fits of one sphere, so their vertices correspond, roughly. A weight is the softmax of the fits,
    times `SHARPNESS`: a regression by a kernel over the space of fits (Nadaraya 1964).

    vertices: (T, 1154, 3) m, of `sphere()` fitted to the objects (`palpate.charts.fit_atlas`). masks: (T, k, 64, 64)
    uint8, the objects as k cameras see them, by `shrunk`; None without vision.
    """

    def __init__(self, vertices: Tensor, masks: Tensor | None = None):
        super().__init__()
        self.register_buffer("vertices", vertices)
        self.register_buffer("masks", masks)

    @cached_property
    def objects(self) -> Objects:
        """What is searched: points on the templates, and their silhouettes."""
        vertices, random = self.vertices.cpu().float(), torch.Generator().manual_seed(0)
        clouds = sample_faces(vertices, sphere()[1], POINTS, random)
        return Objects(clouds, None if self.masks is None else self.masks.cpu() / 255)

    def forward(self, batch: Mapping[str, Tensor]) -> Tensor:
        """Vertices (1824, B, 3) m of vision charts.

        batch, of what there is: `mask`, `hand`, `camera_number`, `success`, `charts` as `Retrieval` takes them;
        `excluded` (B,) int64, the number of a template that is not taken where there is another, or -1.
        """
        # In 16 bits a vertex is placed to a millimetre, and overlaps are good to two digits.
        with torch.autocast(self.vertices.device.type, enabled=False):
            return self._start(batch).transpose(0, 1)

    def _start(self, batch: Mapping[str, Tensor]) -> Tensor:
        searched = {key: batch[key].cpu() for key in SEARCHED if key in batch}
        searched |= {key: shrunk(searched[key]) / 255 for key in ("mask", "hand") if key in searched}
        best, fits = self.objects.best(searched, min(ENSEMBLE, len(self.vertices)))
        weights = torch.softmax(SHARPNESS * fits[:, :STARTS], dim=1).to(self.vertices)
        found = torch.einsum("bk,bkvi->bvi", weights, self.vertices[best[:, :STARTS]])
        touched = touched_points(batch) if "charts" in batch else ()
        for row, points in enumerate(touched):
            others = self.vertices[best[row, fits[row] > EXCLUDED / 2]]
            found[row] = displaced(conditioned(found[row], others, points), sphere()[1], points, BENT)
        return found[:, vision_atlas().position]


def conditioned(vertices: Tensor, ensemble: Tensor, touched: Tensor) -> Tensor:
    """A shape (V, 3) m, moved as an ensemble of shapes (n, V, 3) varies, so that it is the most probable one with
    touched points (m, 3) on its surface.

    Its error is taken to be normally distributed, with the ensemble's covariance (Evensen 2003, "The ensemble Kalman
    filter"), a point's distance to the plane of the nearest face to have the deviation `NOISE` besides.
    """
    moves, faces = (ensemble - ensemble.mean(dim=0)) / len(ensemble) ** 0.5, sphere()[1].to(vertices.device)
    share, found = vertices.new_zeros(len(moves)), vertices
    for _ in range(ROUNDS if len(touched) and len(moves) else 0):
        corners, weights = nearest_on_faces(touched, found, faces)
        one, other, last = found[corners].unbind(1)
        normals = functional.normalize(torch.linalg.cross(other - one, last - one), dim=1) / NOISE
        met = torch.einsum("mk,mki->mi", weights, found[corners])
        along = torch.einsum("mi,mk,nmki->mn", normals, weights, moves[:, corners])
        away = ((touched - met) * normals).sum(dim=1) + along @ share
        share = torch.linalg.solve(along.T @ along + torch.eye(len(moves)).to(along), along.T @ away)
        found = vertices + torch.einsum("n,nvi->vi", share, moves)
    return found


def smoothed(positions: Tensor) -> Tensor:
    """Vertices (1824, B, 3) of vision charts as a closed, smoother surface.

    Vertices of different charts that are one of the sphere are joined at their mean. Then each goes towards the mean of
    its neighbours, and a longer way back, so that the surface does not shrink (Taubin 1995, "A signal processing
    approach to fair surface design").
    """
    place, (start, end) = vision_atlas().position.to(positions.device), mesh_edges(sphere()[1]).T.to(positions.device)
    closed = _mean(positions, place)
    for step in (FORTH, -BACK):
        closed = closed + step * (_mean(closed[end], start) - closed)
    return closed[place]


def _mean(rows: Tensor, groups: Tensor) -> Tensor:
    """The mean of the rows (n, ...) of each group (n,)."""
    sums = rows.new_zeros(int(groups.max()) + 1, *rows.shape[1:]).index_add(0, groups, rows)
    return sums / groups.bincount().to(rows.dtype).reshape(-1, *[1] * (rows.ndim - 1))


def shrunk(masks: Tensor) -> Tensor:
    """Masks (..., p, p) bool at `MASK` pixels along an edge: (..., 64, 64) uint8, 255 where a pixel is all covered."""
    covered = functional.adaptive_avg_pool2d(masks.flatten(0, -3).float()[:, None], MASK)
    return (255 * covered).round().to(torch.uint8).reshape(*masks.shape[:-2], MASK, MASK)
