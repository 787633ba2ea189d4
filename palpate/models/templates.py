"""Templates: fitted charts of training objects, interpolated by kriging to a shape that a reconstruction begins with.
See Uy et al. 2021, "Joint learning of 3D shape retrieval and deformation", of CAD models."""

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from palpate.charts import chamfer_distance, sample_faces, sphere, vision_atlas
from palpate.charts.graph import mesh_edges
from palpate.experiments import Correction
from palpate.models.kriging import displaced, nearest_on_faces, touched_points
from palpate.models.retrieval import EXCLUDED, FARTHEST, TOUCH_WEIGHT, Objects

MASK = 64  # pixels along an edge of the silhouettes that are compared
POINTS = 5000  # on a template, to which touched points' distances are measured
SILHOUETTE, TOUCH = ("mask", "hand", "camera_number"), ("success", "charts")  # keys of a batch
NEIGHBOURS, TOUCH_NEIGHBOURS = 128, 32  # templates that a start is interpolated from; without an image
TOUCH_SCALE = 100.0  # m^-2, in the covariance's exponent, of the mean squared difference of touched points' distances
NUGGET = 0.02  # of the covariance: what differs between objects that feel alike
SCALES = 0.125, 0.5  # of silhouettes' intersection over union, in the covariance's exponent; beside touches the first
SILHOUETTE_NUGGET = 0.003
LEFT_OUT = 400  # templates, at most, that a scale is chosen by
# Of how well the best template fits a sample, to choose among: with less than this a sample begins as a sphere
LEAST_FITS = torch.cat([torch.linspace(0, 1, 21, dtype=torch.float64), torch.tensor([2.0])])
NOISE = 0.01  # m, of a touched point's distance to the surface
ROUNDS = 3  # of looking for the face that is nearest to a touched point, and of conditioning
BENT = Correction(0.08, 0.03)  # of a start to the touched points
FORTH, BACK = 0.5, 1 / (1 / 0.5 - 0.1)  # the two steps of smoothing: a pass band of 0.1 (Taubin 1995)


class Templates(nn.Module):
    """The start of a reconstruction: `templates(batch)`, `kriged` from the templates that fit a sample best,
    `conditioned` by the touched points and bent to them. shapes: (T, 1154, 3) m, fits of `sphere()` to the objects
    (`palpate.charts.fit_atlas`). masks: (T, k, 64, 64) uint8, as k cameras see them, by `shrunk`; None without vision.
    scales: (2,) float64, of silhouettes, without touched points and with; None: by `best_scale`. least_fit: (2,)
    float64, of `fit`, the same."""

    masks: Tensor | None
    scales: Tensor | None

    def __init__(self, shapes: Tensor, masks: Tensor | None = None, scales: Tensor | None = None):
        super().__init__()
        self.shapes = nn.Buffer(shapes)
        self.register_buffer("masks", masks)
        if scales is None and masks is not None:
            scales = torch.tensor([best_scale(shapes, masks[:, 0]), SCALES[0]], dtype=torch.float64)
        self.register_buffer("scales", scales)
        self.least_fit = nn.Buffer(LEAST_FITS[[0, 0]])  # a training chooses it

    @cached_property
    def objects(self) -> Objects:
        """What is searched: points on the templates, and their silhouettes."""
        shapes, random = self.shapes.cpu().float(), torch.Generator().manual_seed(0)
        clouds = sample_faces(shapes, sphere()[1], POINTS, random)
        return Objects(clouds, None if self.masks is None else self.masks.cpu() / 255)

    def forward(self, batch: Mapping[str, Tensor]) -> Tensor:
        """Vertices (1824, B, 3) m of vision charts. batch: as `Retrieval` takes it; `excluded` (B,) int64, the number
        of a template that is not taken where there is another, or -1."""
        keys, count = (SILHOUETTE, NEIGHBOURS) if "mask" in batch else (TOUCH, TOUCH_NEIGHBOURS)
        starts = []
        # In 16 bits a vertex is placed to a millimetre, and overlaps are good to two digits.
        with torch.autocast(self.shapes.device.type, enabled=False):
            searched = _searched(batch, (*keys, "excluded"))
            best, fits = self.objects.best(searched, min(count, len(self.shapes)))
            touched = touched_points(batch) if "charts" in batch else [self.shapes[0, :0]] * len(best)
            for row, points in enumerate(touched):
                allowed = fits[row] > EXCLUDED / 2
                numbers = best[row, allowed] if allowed.any() else best[row]
                sample = {key: searched[key][row] for key in SILHOUETTE if key in searched}
                if sample:
                    exponent, nugget = self._by_silhouette(numbers, len(points) > 0, **sample), SILHOUETTE_NUGGET
                else:
                    exponent, nugget = self._by_touch(numbers, points), NUGGET
                start = conditioned(*kriged(self.shapes[numbers], exponent.exp(), nugget), points)
                starts.append(displaced(start, sphere()[1], points, BENT))
        return torch.stack(starts)[:, vision_atlas().position].transpose(0, 1)

    def fit(self, batch: Mapping[str, Tensor]) -> Tensor:
        """How well (B,) the best template fits each sample, at most 1: the intersection over union of silhouettes or,
        without an image, the share of 5 cm that is left of the root mean square distance of the touched points."""
        if "mask" in batch:
            fits = self.objects.overlap(_searched(batch, SILHOUETTE)).amax(dim=1)
        else:
            squares = -self.objects.best(_searched(batch, TOUCH))[1][:, 0] / TOUCH_WEIGHT
            fits = 1 - squares.clamp(min=0).sqrt() / FARTHEST
        return fits.double().to(self.shapes.device)

    def known(self, batch: Mapping[str, Tensor]) -> Tensor:
        """Whether (B,) each sample begins with templates: one of them fits it well enough."""
        fits = self.fit(batch)
        return fits >= self.least_fit[is_touched(batch, len(fits)).long()]

    def _by_silhouette(
        self, numbers: Tensor, touched: bool, mask: Tensor, camera_number: Tensor, hand: Tensor | None = None
    ) -> Tensor:
        """The logarithm (1 + n, 1 + n) of the covariance of a sample's shape, the first, and n templates, by the
        intersections over union of their silhouettes: positive definite (Bouchard et al. 2013)."""
        assert self.masks is not None and self.scales is not None  # of a strategy with vision
        masks = self.masks[numbers, camera_number].cpu() / 255
        seen = torch.cat([mask[None], masks if hand is None else masks * (1 - hand)]).flatten(1)
        seen = seen[:, seen.amax(dim=0) > 0]  # empty pixels add nothing
        return float(self.scales[int(touched)]) * (alike(seen) - 1)

    def _by_touch(self, numbers: Tensor, touched: Tensor) -> Tensor:
        """The same by the distances of touched points (m, 3) to the surfaces, which to the sample's are 0."""
        places = touched.cpu().double().numpy()
        squares = np.array([np.zeros(len(places)), *(self.objects.squares(int(number), places) for number in numbers)])
        distances = torch.from_numpy(np.sqrt(squares))
        return -TOUCH_SCALE * torch.cdist(distances, distances).square() / max(len(places), 1)


def is_touched(batch: Mapping[str, Tensor], samples: int) -> Tensor:
    """Whether (B,) each sample has touched points."""
    return batch["success"].bool().any(dim=1) if "success" in batch else torch.zeros(samples, dtype=torch.bool)


def _searched(batch: Mapping[str, Tensor], keys: Sequence[str]) -> dict[str, Tensor]:
    """What `Objects` take of a batch, silhouettes as those of templates are."""
    searched = {key: batch[key].cpu() for key in keys if key in batch}
    return searched | {key: shrunk(searched[key]) / 255 for key in ("mask", "hand") if key in searched}


def alike(masks: Tensor) -> Tensor:
    """The intersections over union (n, n) float64 of masks (n, p), shares of pixels."""
    both, areas = masks @ masks.T, masks.sum(dim=1)
    return (both / (areas[:, None] + areas - both).clamp(min=1)).double()


def best_scale(shapes: Tensor, masks: Tensor) -> float:
    """The one of `SCALES` by which shapes (T, V, 3), each interpolated from the others, have the least mean Chamfer
    distance from the shape itself; of a single shape the first. masks: (T, p, p) uint8, their silhouettes."""
    if len(shapes) == 1:
        return SCALES[0]
    overlap, total = alike(masks.flatten(1) / 255), torch.zeros(len(SCALES))
    for number in torch.linspace(0, len(shapes) - 1, min(len(shapes), LEFT_OUT)).long():
        others = overlap[number].index_fill(0, number, -1).topk(min(NEIGHBOURS, len(shapes) - 1)).indices
        chosen = torch.cat([number[None], others])
        exponent = overlap[chosen][:, chosen] - 1
        starts = [kriged(shapes[others], (scale * exponent).exp(), SILHOUETTE_NUGGET)[0] for scale in SCALES]
        random = torch.Generator().manual_seed(0)
        clouds = sample_faces(torch.stack([shapes[number], *starts]), sphere()[1], POINTS, random)
        total += chamfer_distance(clouds[1:], clouds[:1].expand(len(SCALES), -1, -1))
    return SCALES[int(total.argmin())]


def kriged(vertices: Tensor, covariance: Tensor, nugget: float = NUGGET) -> tuple[Tensor, Tensor, Tensor]:
    """A shape (V, 3) m, interpolated from shapes (n, V, 3), and how it may be wrong: by a sum of the n moves
    `factor^-1 off`, with standard normal shares. Returns it, off (n, V, 3) and factor (n, n), which is triangular.
    covariance: (1 + n, 1 + n), of the shape and of those that are known, to which `nugget` is added. Their mean is
    estimated with it (ordinary kriging: Cressie 1993, "Statistics for spatial data", 3.2). The covariance of vertices,
    by which that of shapes is multiplied, is the most probable one (Conti & O'Hagan 2010, "Bayesian emulation of
    complex multi-output and dynamic computer models")."""
    known, ones = covariance[1:, 1:] + nugget * torch.eye(len(vertices)), torch.ones(len(vertices))
    factor = torch.linalg.cholesky(known)
    solved, by_ones = torch.cholesky_solve(torch.stack([covariance[0, 1:], ones.double()], dim=1), factor).unbind(1)
    lack, trend = 1 - solved.sum(), by_ones / by_ones.sum()
    variance = covariance[0, 0] + nugget - covariance[0, 1:] @ solved + lack**2 / by_ones.sum()
    weights, trend, factor = ((solved + lack * trend).to(vertices), trend.to(vertices), factor.to(vertices))
    off = (vertices - torch.einsum("n,nvi->vi", trend, vertices)) * (variance / len(vertices)).sqrt().to(vertices)
    return torch.einsum("n,nvi->vi", weights, vertices), off, factor


def conditioned(vertices: Tensor, off: Tensor, factor: Tensor, touched: Tensor) -> Tensor:
    """A shape, and how it may be wrong, as `kriged` returns them: the most probable one with touched points (m, 3) on
    its surface. A point's distance has the deviation `NOISE` besides (Evensen 2003, "The ensemble Kalman filter"). It
    is measured along normals that are interpolated between vertices: with faces' own, rounding would decide."""
    share, moved, faces = vertices.new_zeros(len(off), 1), vertices, sphere()[1].to(vertices.device)
    for _ in range(ROUNDS if len(touched) else 0):
        corners, weights = nearest_on_faces(touched, moved, faces)
        normals = torch.einsum("mk,mki->mi", weights, vertex_normals(moved, faces)[corners])
        normals = functional.normalize(normals, dim=1) / NOISE
        met = torch.einsum("mk,mki->mi", weights, moved[corners])
        along = torch.einsum("mi,mk,nmki->nm", normals, weights, off[:, corners])
        along = torch.linalg.solve_triangular(factor, along, upper=False)
        away = ((touched - met) * normals).sum(dim=1, keepdim=True) + along.T @ share
        share = torch.linalg.solve(along @ along.T + torch.eye(len(off)).to(along), along @ away)
        by_off = torch.linalg.solve_triangular(factor.T, share, upper=True)[:, 0]
        moved = vertices + torch.einsum("n,nvi->vi", by_off, off)
    return moved


def vertex_normals(vertices: Tensor, faces: Tensor) -> Tensor:
    """Unit normals (V, 3) of a mesh's vertices: of the faces (F, 3) around each the mean, by area."""
    one, other, last = vertices[faces].unbind(1)
    normals = torch.linalg.cross(other - one, last - one).repeat_interleave(3, dim=0)
    return functional.normalize(torch.zeros_like(vertices).index_add(0, faces.flatten(), normals), dim=1)


def smoothed(positions: Tensor) -> Tensor:
    """Vertices (1824, B, 3) of vision charts as a closed, smoother surface: vertices that are one of the sphere joined
    at their mean, then each towards the mean of its neighbours, and a longer way back, so that the surface does not
    shrink (Taubin 1995, "A signal processing approach to fair surface design")."""
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
