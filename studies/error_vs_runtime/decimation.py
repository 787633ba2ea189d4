"""Decimation: how far a mesh with fewer faces is from its source, against the time it takes to make."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import igl
import numpy as np

from palpate.mesh.decimate import collapsed, decimate
from palpate.mesh.distance import Surface
from palpate.mesh.load import load
from palpate.mesh.repair import repair
from studies.error_vs_runtime.study import Method, Study, variants
from studies.subjects import Subject
from studies.surface_distance import distances

FACES = (250, 500, 1000, 2000, 4000, 8000)
Mesh = tuple[np.ndarray, np.ndarray]  # vertices (n, 3), m, and faces (f, 3)


class Source(NamedTuple):
    """The mesh that is decimated, and what measures distances to it."""

    vertices: np.ndarray
    faces: np.ndarray
    surface: Surface


class Decimation(Study):
    """Palpate's quadric collapse (pymeshlab's) beside libigl's. At the config's number it is what a run makes, with
    more faces where the surface moves too far; at others the collapse alone.

    The measure `faces`, the number that remains, is no error: methods compare at equal faces. A mesh
    that stays as it is, because it is small enough already or would move too far, has no error and all its faces. The
    error is NaN for one that libigl rejects (it takes closed manifolds only).
    """

    stage = "decimation"
    units = {"distance": "mm", "mean distance": "mm", "faces": "faces"}
    reference = "the source: exact distances both ways (studies.surface_distance), the largest found and the mean"

    def case(self, subject: Subject) -> Source:
        """The mesh that the object's collision mesh is made from."""
        return load_source(subject.folder)

    def methods(self) -> list[Method]:
        """Both libraries, at several numbers of faces."""
        n = self.settings["mesh"]["collision_faces"]
        faces = sorted({*FACES, n})

        def by_pymeshlab(count: int) -> Callable[[Source], Mesh]:
            return _by(decimate if count == n else collapsed, count)

        return [
            *variants("quadric collapse (pymeshlab)", "faces", faces, by_pymeshlab, n),
            *variants("quadric collapse (libigl)", "faces", faces, partial(_by, _by_libigl)),
        ]

    def errors(self, case: Source, result: Mesh) -> dict[str, float]:
        """Distances both ways, and the faces that remain."""
        if not len(result[1]):
            return dict.fromkeys(self.units, float("nan"))
        level = Surface(*result)
        mean, largest = np.transpose([distances(case.surface, level), distances(level, case.surface)])
        return {"distance": 1e3 * largest.max(), "mean distance": 1e3 * mean.mean(), "faces": len(result[1])}


def load_source(folder: Path) -> Source:
    """The visual mesh in a folder, its seams merged, as `collision.ply` was made from it."""
    parts = load(folder / "visual.glb")[0].parts
    start = np.cumsum([0] + [len(part.vertices) for part in parts])
    vertices = np.concatenate([part.vertices for part in parts]).astype(np.float64)
    faces = np.concatenate([part.faces + first for part, first in zip(parts, start, strict=False)])
    merged = repair(vertices, faces, np.repeat(np.arange(len(parts)), [len(part.faces) for part in parts]))
    faces = merged.faces[merged.keep].astype(np.int64)
    return Source(merged.vertices, faces, Surface(merged.vertices, faces))


def _by(decimated: Callable[..., Mesh], count: int) -> Callable[[Source], Mesh]:
    return lambda case: decimated(case.vertices, case.faces, count)


def _by_libigl(vertices: np.ndarray, faces: np.ndarray, count: int) -> Mesh:
    """Quadric collapse by libigl's `qslim`: no faces if it rejects the mesh, all of them if it is small enough."""
    return igl.qslim(vertices, faces, count)[:2] if len(faces) > count else (vertices, faces)


study = Decimation
