"""The Chamfer distance: error of loss and gradient relative to those between whole surfaces, against time.

A loss samples points of both surfaces, so that it varies from draw to draw. It is biased upwards: the nearest of n
points is further than the surface, by about area / (pi n) in the mean square each way.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import igl
import numpy as np
import torch
import trimesh
from scipy.spatial import cKDTree
from torch import Tensor
from trimesh.triangles import points_to_barycentric

from palpate.charts import build_tree, sample_faces, vision_atlas
from palpate.charts.chamfer import nearest_in_blocks
from palpate.evaluation.metrics import score
from palpate.mesh import OBJECT_POSITION, load_visual
from palpate.mesh.distance import Surface, sample
from palpate.protocol import CHAMFER_SCALE
from palpate.surface import sample as sample_exterior
from palpate.training.losses import Truth, reconstruction_loss, subsample
from studies.error_vs_runtime.study import Method, Study, variants
from studies.subjects import Subject

DRAWS = 12  # from which bias and spread are estimated
FITTED_SHARE = 0.95  # of the way from the atlas to the object: about the error of the default run's models
EXTERIOR_POINTS = 100_000  # that determine which faces of an object are seen from outside
POINTS_ON_TRUTH = 200_000  # of the reference
SUBDIVISIONS = 9  # of each side of a predicted face, into 81 triangles: 187,000 points of the reference
LOSS_POINTS, EVALUATION_POINTS = (500, 1000, 2500, 5000, 10_000), (1000, 3000, 20_000)
SEARCH_ERRORS = (0.1, 0.5, 1.0)  # largest relative excess of a neighbour's distance over the nearest's

Search = Callable[[np.ndarray, np.ndarray], np.ndarray]  # (n, 3), (m, 3) -> (n,) index of a near point of m


class Pair(NamedTuple):
    """A prediction and an object; metres, world frame.

    vertices: (V, 3) float32, faces: (F, 3). truth: points of the object as in training.
    loss: m^2 x 9000, gradient: (V, 3) of the loss by the vertices, per metre; both are the reference.
    """

    vertices: Tensor
    faces: Tensor
    truth: Truth
    loss: float
    gradient: np.ndarray


class Draw(NamedTuple):
    """A loss (m^2 x 9000) and its gradient (V, 3), or None, for one draw of the points."""

    loss: float
    gradient: np.ndarray | None


class Draws(NamedTuple):
    """The first draw, and a function that makes the draw of a seed."""

    first: Draw
    draw: Callable[[int], Draw]


def exact(vertices: np.ndarray, faces: np.ndarray, points: np.ndarray, surface: Surface) -> tuple[float, np.ndarray]:
    """The Chamfer distance (m^2 x 9000) between two surfaces, and its gradient (V, 3) by the vertices of one.

    Distances are to triangles, by libigl in double precision. Means over surfaces are taken over many points; on
    predicted faces these are the centres of equal small triangles. As in training, the gradient does not include
    the density of points.

    Args:
        vertices: (V, 3), faces: (F, 3) of the prediction. points: (n, 3), evenly on the true surface.
        surface: the true one.
    """
    weights, middle = _small_triangles(SUBDIVISIONS)
    corners = vertices[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    share = np.repeat(area / area.sum() / len(weights), len(weights))
    face, bary = np.repeat(np.arange(len(faces)), len(weights)), np.tile(middle, (len(faces), 1))
    on = np.einsum("nk,nkd->nd", bary, corners[face])
    to_truth = on - surface.closest(on)[1]
    tree = igl.AABB()
    tree.init(vertices, faces)
    _, nearest, foot = tree.squared_distance(vertices, faces, points)
    to_prediction, at = foot - points, points_to_barycentric(corners[nearest], foot)
    gradient = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(gradient, faces[face, k], (2 * share * bary[:, k])[:, None] * to_truth)
        np.add.at(gradient, faces[nearest, k], (2 * at[:, k] / len(points))[:, None] * to_prediction)
    loss = share @ (to_truth**2).sum(axis=1) + (to_prediction**2).sum(axis=1).mean()
    return CHAMFER_SCALE * float(loss), CHAMFER_SCALE * gradient


def _small_triangles(cuts: int) -> tuple[np.ndarray, np.ndarray]:
    """Barycentric coordinates of the centres of the cuts^2 equal triangles that a triangle is divided into."""
    up = [(i + 1 / 3, j + 1 / 3) for i in range(cuts) for j in range(cuts - i)]
    down = [(i + 2 / 3, j + 2 / 3) for i in range(cuts) for j in range(cuts - i - 1)]
    two = np.array(up + down) / cuts
    return two, np.column_stack([1 - two.sum(axis=1), two])


def outer_faces(mesh: trimesh.Trimesh) -> np.ndarray:
    """Faces (f, 3) of a mesh with points of its exterior on them."""
    surface = Surface(mesh.vertices, mesh.faces)
    points = sample_exterior(mesh, EXTERIOR_POINTS, np.random.default_rng(0))
    _, face, _ = surface.tree.squared_distance(surface.vertices, surface.faces, points)
    return surface.faces[np.unique(face)]


def fitted_atlas(surface: Surface, share: float) -> np.ndarray:
    """Vertices (1824, 3) of the atlas, moved by `share` of the way to the nearest points of a surface."""
    start = vision_atlas().vertices.double().numpy()
    return start + share * (surface.closest(start)[1] - start)


class Chamfer(Study):
    """A prediction like a trained model's, against the faces of each object that are seen from outside.

    The object's points are the same in every draw, as in training: the effect of their choice is bias.
    """

    stage = "chamfer distance"
    units = dict.fromkeys(
        (
            *("loss: root mean square", "loss: bias", "loss: spread", "gradient: bias", "gradient: spread"),
            *("score: bias", "score: spread"),
        ),
        "%",
    )
    reference = (
        "between the surfaces themselves: exact distances to triangles by libigl, from 187,000 and 200,000 "
        f"points, in double precision; {DRAWS} draws of each method"
    )

    def case(self, subject: Subject) -> Pair:
        mesh = load_visual(subject.folder)
        return pair(mesh.vertices + np.array(OBJECT_POSITION), outer_faces(mesh), self.settings["surface"]["points"])

    def methods(self) -> list[Method]:
        n, of_score = self.settings["recipe"]["reconstruction"]["loss_points"], self.settings["evaluation"]["points"]
        searches: dict[str, Search] = {
            "k-d tree of the library's defaults": lambda a, b: cKDTree(b).query(a)[1],
            "all pairs": _all_pairs,
            **{f"k-d tree, up to {error:.0%} further": partial(_approximate, error) for error in SEARCH_ERRORS},
        }
        changes = [("search", name, {"search": search}) for name, search in searches.items()]
        changes += [("precision", str(t)[6:], {"dtype": t}) for t in (torch.float64, torch.bfloat16, torch.float16)]
        changes += [("true points", n, {"few_true_points": True})]
        name, counts, scored = "loss of training", sorted({*LOSS_POINTS, n}), sorted({*EVALUATION_POINTS, of_score})
        return [
            *variants(name, "points", counts, lambda k: partial(training_loss, k), n),
            *variants("evaluation", "points", scored, lambda k: partial(evaluation_score, k), of_score),
            *(Method(name, knob, value, partial(changed_loss, n, **how)) for knob, value, how in changes),
        ]

    def errors(self, case: Pair, result: Draws) -> dict[str, float]:
        losses, gradients = zip(result.first, *(result.draw(seed) for seed in range(1, DRAWS)), strict=True)
        off, errors = 100 * (np.array(losses) / case.loss - 1), dict.fromkeys(self.units, float("nan"))
        bias, spread = abs(float(off.mean())), float(off.std(ddof=1))
        if gradients[0] is None:
            return errors | {"score: bias": bias, "score: spread": spread}
        errors |= {
            "loss: root mean square": float(np.sqrt(np.mean(off**2))),
            "loss: bias": bias,
            "loss: spread": spread,
        }
        scale = 100 / np.linalg.norm(case.gradient)
        bias, spread = _bias_and_spread(np.stack(gradients) - case.gradient)
        return errors | {"gradient: bias": float(scale * bias), "gradient: spread": float(scale * spread)}


def _bias_and_spread(off: np.ndarray) -> tuple[float, float]:
    """Lengths of the mean and of the standard deviation of vectors (n, ...).

    The squared length of the mean is the product of the means of two halves, which has no bias; at least 0.
    """
    halves = off[::2].mean(axis=0), off[1::2].mean(axis=0)
    return max(float((halves[0] * halves[1]).sum()), 0.0) ** 0.5, float(off.var(axis=0, ddof=1).sum()) ** 0.5


def pair(vertices: np.ndarray, faces: np.ndarray, count: int) -> Pair:
    """The case of one object: vertices (n, 3) m in the world, faces (f, 3); `count` points are its truth."""
    surface = Surface(vertices, faces)
    atlas = vision_atlas()
    predicted = torch.from_numpy(fitted_atlas(surface, FITTED_SHARE)).float()
    points = sample(surface.vertices, surface.faces, POINTS_ON_TRUTH)
    loss, gradient = exact(predicted.double().numpy(), atlas.faces.numpy(), points, surface)
    mesh = torch.from_numpy(surface.vertices)[None].float(), torch.from_numpy(surface.faces)
    truth = Truth(sample_faces(*mesh, count, torch.Generator().manual_seed(0)))
    truth.trees([0])
    return Pair(predicted, atlas.faces, truth, loss, gradient)


def draws_of(function: Callable[[Tensor, torch.Generator], Tensor], case: Pair) -> Draws:
    """Draws of a loss, a function of vertices (1, V, 3) and a generator, with its gradient if it has one."""

    def draw(seed: int) -> Draw:
        vertices = case.vertices[None].clone().requires_grad_()
        loss = function(vertices, torch.Generator().manual_seed(seed))
        if not loss.requires_grad:
            return Draw(float(loss), None)
        loss.backward()
        return Draw(float(loss.detach()), vertices.grad[0].double().numpy())

    return Draws(draw(0), draw)


def training_loss(n: int, case: Pair) -> Draws:
    """The loss of a training step, and its gradient."""
    return draws_of(lambda v, g: reconstruction_loss(v, case.faces, case.truth, [0], n, g).sum(), case)


def evaluation_score(n: int, case: Pair) -> Draws:
    """The Chamfer distance of an evaluation."""

    def chamfer(vertices: Tensor, generator: torch.Generator) -> Tensor:
        with torch.no_grad():
            points = sample_faces(vertices, case.faces, n, generator)[0]
        return torch.tensor(score(points, case.truth.points[0], case.truth.trees([0])[0]).chamfer)

    return draws_of(chamfer, case)


def changed_loss(
    n: int, case: Pair, search: Search | None = None, dtype: torch.dtype = torch.float32, few_true_points: bool = False
) -> Draws:
    """The loss of training with one change.

    search: finds the nearest neighbours; None: as in training. dtype: of clouds and sums; neighbours are always found
    in double precision. few_true_points: use only n of the true points, too.
    """

    def loss(vertices: Tensor, generator: torch.Generator) -> Tensor:
        points = sample_faces(vertices, case.faces, n, generator)[0].to(dtype)
        cloud = case.truth.points[0].to(dtype)
        chosen = subsample(cloud, n, generator)
        target, tree = (chosen, None) if few_true_points else (cloud, case.truth.trees([0])[0])
        to_truth = _mean(points, target, search, tree)
        return CHAMFER_SCALE * (to_truth + _mean(chosen, points, search, None))

    return draws_of(loss, case)


def _mean(query: Tensor, points: Tensor, search: Search | None, tree: cKDTree | None) -> Tensor:
    q, p = (cloud.detach().double().numpy() for cloud in (query, points))
    index = search(q, p) if search else (tree or build_tree(torch.from_numpy(p))).query(q)[1]
    return (query - points[torch.from_numpy(index)]).square().sum(dim=1).mean()


def _all_pairs(query: np.ndarray, points: np.ndarray) -> np.ndarray:
    return nearest_in_blocks(torch.from_numpy(query).float(), torch.from_numpy(points).float()).numpy()


def _approximate(error: float, query: np.ndarray, points: np.ndarray) -> np.ndarray:
    return build_tree(torch.from_numpy(points)).query(query, eps=error)[1]


study = Chamfer
