"""Surface sampling: which area gets points and how evenly, against time."""

from collections.abc import Iterable
from functools import partial
from typing import NamedTuple

import igl
import numpy as np
import trimesh
from scipy.spatial import cKDTree
from scipy.stats import qmc

from palpate.mesh import load_visual
from palpate.surface import DIRECTIONS, sample, sees_out
from palpate.surface.embree import RayMesh
from studies.error_vs_runtime.study import Method, Study, variants

COUNTS = (16, 32, 64, 128, 256)  # directions of rays

# Directions of the reference: four times as many find 0.1 % more exterior points on eight objects.
REFERENCE = 1024
# Number of test points on shapes whose exterior is known in closed form, and on the run's objects.
SHAPE_POINTS, OBJECT_POINTS = 20_000, 2_000
# Differs from the methods' seed: with the same one trimesh would draw the same points.
POINTS_SEED = 1


class Case(NamedTuple):
    """A mesh, and test points on it, uniform by area.

    points: (n, 3). face: (n,) of `mesh.faces`. exterior: (n,) bool, whether a point is visible from outside.
    """

    mesh: trimesh.Trimesh
    points: np.ndarray
    face: np.ndarray
    exterior: np.ndarray


class Sampled(NamedTuple):
    """Points (k, 3) sampled by visibility in a number of directions."""

    points: np.ndarray
    directions: int


class Surface(Study):
    """Visibility rays in more or fewer directions, on two shapes whose exterior is known and on two objects.

    `misclassified` is the hidden area that gets points plus the exterior area that gets none. The Chamfer distance is
    not zero for exact samples either.
    """

    stage = "surface"
    units = {"misclassified": "% of the exterior", "Chamfer distance": "mm"}
    reference = (
        "shapes: the exterior in closed form, 20,000 places; objects: 2,000 places by area (trimesh), each "
        f"seeing out in any of {REFERENCE} Sobol directions (libigl's tree of boxes, double precision)"
    )
    objects = 2

    def cases(self) -> Iterable[tuple[str, Case]]:
        """Two shapes whose exterior is known, and the run's objects."""
        yield "overlapping spheres", overlapping_spheres()
        yield "cup 4 radii deep", cup(4)
        for subject in self.subjects:
            yield subject.name, traced_case(load_visual(subject.folder))

    def methods(self) -> list[Method]:
        """Several numbers of directions."""
        return variants("rays", "directions", COUNTS, lambda n: partial(self._rays, n), DIRECTIONS)

    def errors(self, case: Case, result: Sampled) -> dict[str, float]:
        """Misclassified area, and the Chamfer distance to points of the exterior."""
        exact = case.points[case.exterior]
        to_sampled, to_exterior = cKDTree(result.points).query(exact)[0], cKDTree(exact).query(result.points)[0]
        return {
            "misclassified": 100 * (self.classify(result, case) != case.exterior).sum() / len(exact),
            "Chamfer distance": 1e3 * (to_sampled.mean() + to_exterior.mean()),
        }

    def _rays(self, directions: int, case: Case) -> Sampled:
        points = self.settings["surface"]["points"]
        sampled = sample(case.mesh, points, np.random.default_rng(0), directions)
        return Sampled(sampled, directions)

    @staticmethod
    def classify(result: Sampled, case: Case) -> np.ndarray:
        """Which points of a case (n,) bool the method takes for exterior."""
        mesh = RayMesh(case.mesh)
        return sees_out(mesh, case.points, np.searchsorted(mesh.face, case.face), result.directions)


def visible(mesh: trimesh.Trimesh, points: np.ndarray, face: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Whether each point (n, 3) of a face (n,) is visible from outside along any of the directions (d, 3): (n,) bool.

    In double precision; a face is not visible edge-on.
    """
    # libigl treats rays as parallel to a face if its absolute area is small.
    scale = 1e6 / mesh.extents.max()
    vertices, faces = np.ascontiguousarray(scale * mesh.vertices), np.ascontiguousarray(mesh.faces)
    tree = igl.AABB()
    tree.init(vertices, faces)
    normal = mesh.face_normals[face]
    hidden = np.arange(len(points))
    for direction in directions:
        cosine = normal[hidden] @ direction
        start = scale * points[hidden] + 1e-3 * np.sign(cosine)[:, None] * normal[hidden]
        met, _, _ = tree.intersect_ray_first(vertices, faces, start, np.tile(direction, (len(hidden), 1)), np.inf)
        hidden = hidden[(met >= 0) | (np.abs(cosine) < 1e-6)]
    return ~np.isin(np.arange(len(points)), hidden)


def traced_case(mesh: trimesh.Trimesh, count: int = OBJECT_POINTS, directions: int = REFERENCE) -> Case:
    """The case of any mesh: its exterior is what is visible along some direction."""
    points, face = _sample_points(mesh, count)
    return Case(mesh, points, face, visible(mesh, points, face, sobol_sphere(directions)))


def sobol_sphere(count: int) -> np.ndarray:
    """Unit vectors (count, 3) spread evenly over the sphere (Sobol sequence, scrambled); 2^k of them."""
    u, v = qmc.Sobol(2, rng=0).random(count).T
    radius, angle = np.sqrt(1 - (2 * u - 1) ** 2), 2 * np.pi * v
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), 2 * u - 1], axis=1)


def overlapping_spheres() -> Case:
    """Two convex polyhedra of 0.1 m radius, 0.1 m apart: the area inside the other one is hidden."""
    balls = [trimesh.creation.icosphere(subdivisions=4, radius=0.1).apply_translation((x, 0, 0)) for x in (0, 0.1)]
    mesh = trimesh.util.concatenate(balls)
    points, face = _sample_points(mesh)
    exterior = np.ones(len(points), dtype=bool)
    for k, other in enumerate(reversed(balls)):
        away = np.linalg.norm(points - other.center_mass, axis=1)
        near = np.flatnonzero((face // len(other.faces) == k) & (away < 0.1))
        height = np.einsum("fi,fi->f", other.face_normals, other.triangles[:, 0])
        exterior[near] = [(other.face_normals @ point > height).any() for point in points[near]]
    return Case(mesh, points, face, exterior)


def cup(depth: float) -> Case:
    """A cup `depth` radii (50 mm) deep with walls of 1 mm: all of it is exterior, the floor barely."""
    radius, inner = 0.05, 0.049
    height = radius * depth
    profile = np.array([[0, 0], [radius, 0], [radius, height], [inner, height], [inner, 0.001], [0, 0.001]])
    mesh = trimesh.creation.revolve(profile, sections=96).subdivide().subdivide()
    points, face = _sample_points(mesh)
    return Case(mesh, points, face, np.ones(len(points), dtype=bool))


def _sample_points(mesh: trimesh.Trimesh, count: int = SHAPE_POINTS) -> tuple[np.ndarray, np.ndarray]:
    points, face = trimesh.sample.sample_surface(mesh, count, seed=POINTS_SEED)
    return np.asarray(points), np.asarray(face)


study = Surface
