"""The Chamfer distance: error of loss and score relative to the distance between whole surfaces, against time.

A loss samples points of both surfaces, so that it varies from draw to draw. It is biased upwards: the nearest of n
points is further than the surface, by about area / (pi n) in the mean square each way.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
import torch
import trimesh
from torch import Tensor

from palpate.charts import sample_faces, vision_atlas
from palpate.learning.metrics import score
from palpate.mesh import OBJECT_POSITION, load_visual
from palpate.mesh.distance import Surface
from palpate.models.losses import Target, Truth, reconstruction_loss
from palpate.protocol import CHAMFER_SCALE
from palpate.surface import sample as sample_exterior
from studies.error_vs_runtime.study import Method, Study, variants
from studies.subjects import Subject
from studies.surface_distance import sample

DRAWS = 12  # from which bias and spread are estimated
FITTED_SHARE = 0.95  # of the way from the atlas to the object: about the error of the default run's models
EXTERIOR_POINTS = 100_000  # that determine which faces of an object are seen from outside
REFERENCE_POINTS = 200_000  # of the reference, on each surface
LOSS_POINTS, EVALUATION_POINTS = (500, 1000, 2500, 5000, 10_000), (1000, 3000, 20_000)


class Pair(NamedTuple):
    """A prediction and an object; metres, world frame.

    vertices: (V, 3) float32, faces: (F, 3). truth: points of the object as in training. distance: m^2 x 9000, the
    reference.
    """

    vertices: Tensor
    faces: Tensor
    truth: Truth
    distance: float


class Draws(NamedTuple):
    """The first draw of the points, and a function that makes the draw of a seed: m^2 x 9000. of: `loss` or `score`."""

    of: str
    first: float
    draw: Callable[[int], float]


def exact(vertices: np.ndarray, faces: np.ndarray, points: np.ndarray, surface: Surface) -> float:
    """The Chamfer distance (m^2 x 9000) between two surfaces: distances of many points to triangles, by libigl.

    vertices: (V, 3), faces: (F, 3) of the prediction. points: (n, 3), evenly on the true surface.
    """
    on = sample(vertices, faces, REFERENCE_POINTS)
    squares = [(p - other.closest(p)[1]) ** 2 for p, other in ((on, surface), (points, Surface(vertices, faces)))]
    return CHAMFER_SCALE * float(sum(one_way.sum(axis=1).mean() for one_way in squares))


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
    units = dict.fromkeys(("loss: root mean square", "loss: bias", "loss: spread", "score: bias", "score: spread"), "%")
    reference = (
        f"between the surfaces themselves: exact distances to triangles by libigl, from {REFERENCE_POINTS:,} points "
        f"each way, in double precision; {DRAWS} draws of each method"
    )

    def case(self, subject: Subject) -> Pair:
        """The object, and a prediction near it."""
        mesh = load_visual(subject.folder)
        return pair(mesh.vertices + np.array(OBJECT_POSITION), outer_faces(mesh), self.settings["surface"]["points"])

    def methods(self) -> list[Method]:
        """Losses and scores of several numbers of points."""
        n, of_score = self.settings["recipe"]["reconstruction"]["loss_points"], self.settings["evaluation"]["points"]
        counts, scored = sorted({*LOSS_POINTS, n}), sorted({*EVALUATION_POINTS, of_score})
        return [
            *variants("loss of training", "points", counts, lambda k: partial(training_loss, k), n),
            *variants("evaluation", "points", scored, lambda k: partial(evaluation_score, k), of_score),
        ]

    def errors(self, case: Pair, result: Draws) -> dict[str, float]:
        """Errors of `DRAWS` draws relative to the distance, in percent; NaN for the measures of the other method."""
        draws = np.array([result.first, *map(result.draw, range(1, DRAWS))])
        off = 100 * (draws / case.distance - 1)
        values = float(np.mean(off**2) ** 0.5), abs(float(off.mean())), float(off.std(ddof=1))
        names = (f"{result.of}: {key}" for key in ("root mean square", "bias", "spread"))
        errors = dict(zip(names, values, strict=True))
        return {key: errors.get(key, float("nan")) for key in self.units}


def pair(vertices: np.ndarray, faces: np.ndarray, count: int) -> Pair:
    """The case of one object: vertices (n, 3) m in the world, faces (f, 3); `count` points are its truth."""
    surface, atlas = Surface(vertices, faces), vision_atlas()
    predicted = torch.from_numpy(fitted_atlas(surface, FITTED_SHARE)).float()
    points = sample(surface.vertices, surface.faces, REFERENCE_POINTS)
    distance = exact(predicted.double().numpy(), atlas.faces.numpy(), points, surface)
    mesh = torch.from_numpy(surface.vertices)[None].float(), torch.from_numpy(surface.faces)
    truth = Truth(sample_faces(*mesh, count, torch.Generator().manual_seed(0)))
    truth.tree(0)
    return Pair(predicted, atlas.faces, truth, distance)


def training_loss(n: int, case: Pair) -> Draws:
    """The loss of a training step; its gradient is taken, too."""

    def draw(seed: int) -> float:
        vertices = case.vertices[None].clone().requires_grad_()
        generator = torch.Generator().manual_seed(seed)
        loss = reconstruction_loss(vertices, case.faces, Target(case.truth, [0], n, generator)).sum()
        loss.backward()
        return float(loss.detach())

    return Draws("loss", draw(0), draw)


def evaluation_score(n: int, case: Pair) -> Draws:
    """The Chamfer distance of an evaluation."""

    def draw(seed: int) -> float:
        points = sample_faces(case.vertices[None], case.faces, n, torch.Generator().manual_seed(seed))[0]
        return score(points, case.truth.tree(0)).chamfer

    return Draws("score", draw(0), draw)


study = Chamfer
