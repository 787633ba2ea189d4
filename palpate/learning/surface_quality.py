"""How smooth a predicted surface is: four numbers of the vision charts, or the sphere.

- `bend`: mean angle in degrees between adjacent faces of a chart, 0 where it is flat (the angle that discrete shells
  resist: Grinspun et al. 2003, Discrete Shells). A sphere of the atlas's size and faces has 4.9.
- `folded`: percent of these pairs whose angle is above 90 degrees: one of the two is turned over against the other.
- `gap`: mean distance in mm between boundary vertices that were one point of the initial sphere; 0 for the sphere.
- `across`: mean angle in degrees, weighted by area, between every fourth face and the true surface at the point nearest
  to its centre (normals: `plane_normals`, without sign); 0 where they are parallel, 57 for random faces. It is the
  angle of the normal consistency of Mescheder et al. (2019, Occupancy Networks)."""

from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from palpate.charts import plane_normals, sphere, vision_atlas
from palpate.strategies import Start

FOLDED = 90.0  # degrees
# Faces that are compared with the true surface: every fourth of the charts', and about as many of a finer mesh. Such an
# angle costs as much as a hundred between faces.
ACROSS_EVERY, ACROSS = 4, 1000


class Quality(NamedTuple):
    """The numbers of the module's text: degrees, percent, mm, degrees."""

    bend: float
    folded: float
    gap: float
    across: float


class Topology(NamedTuple):
    """Faces (F, 3), pairs (E, 2) of faces that share a side within a chart, pairs (J, 2) of joined vertices."""

    faces: np.ndarray
    adjacent: np.ndarray
    joined: np.ndarray


@cache
def topology(start: Start | None) -> Topology | None:
    """Of what a strategy deforms: the vision charts or the closed sphere; None for neither."""
    if start is None:
        return None
    faces, joined = sphere()[1].numpy(), np.zeros((0, 2), dtype=int)
    if start != "sphere":
        faces, joined = vision_atlas().faces.numpy(), vision_atlas().joined.numpy()
    sides = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1) @ [1, faces.max() + 1]
    order = np.argsort(sides, kind="stable")
    _, first, count = np.unique(sides[order], return_index=True, return_counts=True)
    first = first[count == 2]
    adjacent = order[np.stack([first, first + 1], axis=1)] // 3
    return Topology(faces, adjacent, joined)


def surface_quality(vertices: np.ndarray, surface: Topology | None, tree: cKDTree) -> Quality:
    """The numbers of one prediction; nan without a surface. vertices: (V, 3) metres, of which `surface` takes the
    first. tree: of the true points, in the same frame. Faces without area have no direction and are left out."""
    if surface is None:
        return Quality(*[np.nan] * 4)
    vertices = np.asarray(vertices, dtype=float)
    corners = vertices[surface.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    doubled = np.linalg.norm(normal, axis=1)
    normal /= np.maximum(doubled, np.finfo(float).tiny)[:, None]
    first, second = surface.adjacent[(doubled[surface.adjacent] > 0).all(axis=1)].T
    angles = np.degrees(np.arccos(np.clip((normal[first] * normal[second]).sum(axis=1), -1, 1)))
    apart = np.linalg.norm(np.subtract(*vertices[surface.joined.T]), axis=1)
    some = slice(None, None, max(ACROSS_EVERY, len(corners) // ACROSS))  # of every chart 6 of 24
    _, nearest = tree.query(corners[some].mean(axis=1))
    parallel = np.abs((normal[some] * plane_normals(tree.data[nearest], tree)).sum(axis=1))
    across = np.degrees(np.arccos(np.clip(parallel, 0, 1)))
    return Quality(
        bend=float(angles.mean()),
        folded=100 * float(np.mean(angles > FOLDED)),
        gap=1000 * float(apart.mean()) if len(apart) else 0.0,
        across=float(np.average(across, weights=doubled[some])),
    )
