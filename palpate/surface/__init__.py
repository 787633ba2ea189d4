"""Points spread uniformly over the exterior surface of an object: that from which a straight line leads to infinity."""

import numpy as np

from palpate.mesh import Mesh
from palpate.surface.embree import RayMesh

# Evenly over the sphere. More directions find points that see out through narrower openings (docs/surface.md).
DIRECTIONS = 64
# Share of the mesh's extent that a ray starts off its face: far enough not to meet that face in single precision, near
# enough not to jump over a thin wall (1e-6 m for an object of 0.5 m).
_OFFSET = 2e-6
_MOST_CANDIDATES = 200  # drawn in all, as a multiple of the points asked for


def fibonacci_sphere(count: int) -> np.ndarray:
    """(count, 3) unit vectors spread evenly over the sphere, none along an axis (Fibonacci lattice)."""
    step = np.arange(count) + 0.5
    height = 1 - 2 * step / count
    angle = np.pi * (1 + np.sqrt(5)) * step
    radius = np.sqrt(1 - height**2)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)


def sample(mesh: Mesh, count: int, rng: np.random.Generator, directions: int = DIRECTIONS) -> np.ndarray:
    """Points (count, 3) float64, in the mesh's frame and in random order, uniform by area on its exterior surface.
    Exterior is what a straight line reaches from outside, through openings too; the mesh may be open, non-manifold or
    flipped. Raises ValueError for a mesh without area, or if too little of it is exterior."""
    rays = RayMesh(mesh)
    exterior: list[np.ndarray] = []
    drawn, missing = 0, count
    area = np.cumsum(np.linalg.norm(rays.normals, axis=1))
    while missing > 0:
        if drawn > _MOST_CANDIDATES * count:
            raise ValueError(
                f"expected {count} exterior points, found {count - missing} among {drawn} candidates: "
                "nearly all of the surface is hidden inside the object; remove its interior parts"
            )
        # How many candidates the missing points take, by the share of exterior ones so far.
        share = (count - missing + 1) / (drawn + 1)
        batch = min(int(1.05 * missing / share) + 100, 4 * count)
        face = np.minimum(np.searchsorted(area, rng.random(batch) * area[-1], side="right"), len(area) - 1)
        # The square root makes the barycentric coordinates uniform over the triangle (Osada et al. 2002).
        root, part = np.sqrt(rng.random((batch, 1))), rng.random((batch, 1))
        a, b, c = rays.triangles[face].transpose(1, 0, 2)
        points = (1 - root) * a + root * (1 - part) * b + root * part * c
        points = points[sees_out(rays, points, face, directions)]
        exterior.append(points)
        drawn += batch
        missing -= len(points)
    return np.concatenate(exterior)[:count]


def sees_out(mesh: RayMesh, points: np.ndarray, face: np.ndarray, directions: int = DIRECTIONS) -> np.ndarray:
    """Whether each point sees infinity from either side of its face, in any direction: (n,) bool."""
    normal = mesh.normals[face]
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    offset = _OFFSET * (mesh.high - mesh.low).max() * normal
    hidden = np.argsort(face)  # neighbours meet the same nodes of the tree
    # Along the normals first: most exterior points are settled by one ray or two.
    for side in (1, -1):
        start = points[hidden] + side * offset[hidden]
        hidden = hidden[mesh.blocked(start, side * normal[hidden])]
    starts = np.stack([points[hidden] - offset[hidden], points[hidden] + offset[hidden]])
    toward, left = fibonacci_sphere(directions), np.arange(len(hidden))
    for direction, side in zip(toward, (toward @ normal[hidden].T > 0).astype(int), strict=True):
        left = left[mesh.blocked(starts[side[left], left], direction[None])]
    out = np.ones(len(points), dtype=bool)
    out[hidden[left]] = False
    return out
