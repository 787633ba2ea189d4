"""Decimation: how far a mesh with fewer faces is from its source, against the time it takes to make."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import igl
import manifold3d
import numpy as np
import pymeshlab

from palpate.mesh.decimate import PLANAR_WEIGHT, QUALITY, decimate
from palpate.mesh.distance import Surface, distance
from palpate.mesh.load import load_parts
from palpate.mesh.repair import repair
from studies.error_vs_runtime.study import Method, Study, variants
from studies.subjects import Subject

FACES = (250, 500, 1000, 2000, 4000, 8000)
PLANAR_WEIGHTS = (0.0, PLANAR_WEIGHT, 1e-3)  # 0.001 is pymeshlab's own
QUALITIES = (0.03, 0.1, QUALITY)
TOLERANCES = (0.05, 0.2, 0.8)  # mm
CELLS = (0.25, 0.5, 1.0)  # % of the diagonal

Mesh = tuple[np.ndarray, np.ndarray]  # vertices (n, 3), m, and faces (f, 3)


class Source(NamedTuple):
    """The mesh that is decimated, and what measures distances to it."""

    vertices: np.ndarray
    faces: np.ndarray
    surface: Surface


class Decimation(Study):
    """Palpate's quadric collapse (pymeshlab's) beside libigl's, and two cruder methods.

    The measure `faces`, the number that remains, is no error: methods compare at equal faces. The error is NaN for
    a mesh that is small enough already, because it is not decimated. It is NaN for a mesh that the method rejects,
    too (libigl's and manifold3d's take closed manifolds only).
    """

    stage = "decimation"
    units = {"distance": "mm", "mean distance": "mm", "faces": "faces"}
    reference = (
        "the source: exact distances (libigl's tree of boxes) both ways, at corners, at 8,000 points by area "
        "and where they are largest (palpate.mesh.distance): the largest, and the mean of both ways"
    )

    def case(self, subject: Subject) -> Source:
        return load_source(subject.folder)

    def methods(self) -> list[Method]:
        quadric, n = "quadric collapse (pymeshlab)", self.settings["mesh"]["collision_faces"]
        faces = sorted({*FACES, n})
        return [
            *variants(quadric, "faces", faces, lambda value: _by(decimate, value), n),
            *variants(quadric, "planar weight", PLANAR_WEIGHTS, lambda w: _by(decimate, n, w), PLANAR_WEIGHT),
            *variants(quadric, "quality", QUALITIES, lambda q: _by(decimate, n, PLANAR_WEIGHT, q), QUALITY),
            *variants("quadric collapse (libigl)", "faces", faces, lambda value: _by(_by_libigl, value)),
            *variants("collapse within a tolerance (manifold3d)", "mm", TOLERANCES, lambda t: _by(_within, t)),
            *variants("clusters (pymeshlab)", "% of diagonal", CELLS, lambda cell: _by(_clusters, cell)),
        ]

    def errors(self, case: Source, result: Mesh | None) -> dict[str, float]:
        if result is None or not 0 < len(result[1]) < len(case.faces):
            return dict.fromkeys(self.units, float("nan"))
        level = Surface(*result)
        to_level, to_source = distance(case.surface, level), distance(level, case.surface)
        largest, mean = max(to_level["max"], to_source["max"]), (to_level["mean"] + to_source["mean"]) / 2
        return {"distance": 1e3 * largest, "mean distance": 1e3 * mean, "faces": len(result[1])}


def load_source(folder: Path) -> Source:
    """The visual mesh in a folder, its seams merged, as its levels were made from it."""
    parts = load_parts(folder / "visual.glb")
    start = np.cumsum([0] + [len(part.vertices) for part in parts])
    vertices = np.concatenate([part.vertices for part in parts]).astype(np.float64)
    faces = np.concatenate([part.faces + first for part, first in zip(parts, start, strict=False)])
    merged = repair(vertices, faces, np.repeat(np.arange(len(parts)), [len(part.faces) for part in parts]))
    faces = merged.faces[merged.keep].astype(np.int64)
    return Source(merged.vertices, faces, Surface(merged.vertices, faces))


def _by(decimated: Callable[..., Mesh | None], *knobs: float) -> Callable[[Source], Mesh | None]:
    return lambda case: decimated(case.vertices, case.faces, *knobs)


def _by_libigl(vertices: np.ndarray, faces: np.ndarray, count: int) -> Mesh | None:
    """Quadric collapse by libigl's `qslim`: no faces if it rejects the mesh, None if the mesh is small enough."""
    return igl.qslim(vertices, faces, count)[:2] if len(faces) > count else None


def _within(vertices: np.ndarray, faces: np.ndarray, tolerance: float) -> Mesh | None:
    """manifold3d's collapse within a tolerance in mm; None if it rejects the mesh."""
    solid = manifold3d.Manifold(manifold3d.Mesh64(vertices, faces.astype(np.uint64)))
    if solid.status() != manifold3d.Error.NoError:
        return None
    mesh = solid.simplify(1e-3 * tolerance).to_mesh64()
    return np.array(mesh.vert_properties[:, :3]), np.array(mesh.tri_verts, dtype=np.int64)


def _clusters(vertices: np.ndarray, faces: np.ndarray, cell: float) -> Mesh:
    """Merge the vertices in each cell of a grid; cell in % of the bounding box's diagonal."""
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(vertices, faces))
    meshes.meshing_decimation_clustering(threshold=pymeshlab.PercentageValue(cell))
    mesh = meshes.current_mesh()
    return mesh.vertex_matrix(), mesh.face_matrix().astype(np.int64)


study = Decimation
