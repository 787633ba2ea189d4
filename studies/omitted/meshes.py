"""Omissions of mesh preparation: meshes that are small enough are neither decimated nor measured."""

import tempfile
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import trimesh

from palpate import mesh
from palpate.mesh.decimate import collapse
from palpate.mesh.distance import Surface, distance
from studies.omitted.omission import Omission
from studies.subjects import Subject

WAYS = ("source_to_level", "level_to_source")


class Level(NamedTuple):
    """collision.ply: vertices (n, 3), metres, and faces (f, 3); record: of it in `mesh.json`."""

    vertices: np.ndarray
    faces: np.ndarray
    record: dict[str, Any]


def omissions(run: Path, subjects: list[Subject], settings: Mapping) -> Iterator[Omission]:
    """Prepare objects from their own collision meshes, which have few enough faces already."""
    for subject in subjects:
        faces = max(settings["mesh"]["collision_faces"], len(mesh.load_collision(subject.folder).faces))
        make = partial(prepared_level, subject.folder / "collision.ply", faces)
        for item, (omitted, bound) in ITEMS.items():
            with_it = lambda make=make, omitted=omitted: omitted(make())  # noqa: E731
            when = "a mesh has no more faces than a level asks for"
            yield Omission("mesh", item, when, subject.name, with_it, make, difference, "m", bound)


def prepared_level(source: Path, faces: int) -> Level:
    """The collision mesh of an object with at most `faces` faces, as the workflow's stage makes it."""
    with tempfile.TemporaryDirectory() as folder:
        record = mesh.prepare(source, folder, collision_faces=faces, levels=())
        level = trimesh.load_mesh(Path(folder) / "collision.ply", process=False)
    return Level(np.asarray(level.vertices), np.asarray(level.faces), record["collision.ply"])


def decimate_level(level: Level) -> Level:
    """Decimate a level to its requested number of faces."""
    vertices, faces = collapse(level.vertices, level.faces, level.record["asked"])
    return level._replace(vertices=vertices, faces=faces)


def measure_level(level: Level) -> Level:
    """Measure a level's distance to itself, as that of any other level to its source."""
    surface = Surface(level.vertices, level.faces)
    return level._replace(record=level.record | {way: distance(surface, surface) for way in WAYS})


def difference(one: Level, other: Level) -> float:
    """Largest difference (m) of vertices and of recorded distances; infinite if faces are not the same."""
    if one.vertices.shape != other.vertices.shape or not np.array_equal(one.faces, other.faces):
        return np.inf
    recorded = [abs(one.record[way][key] - other.record[way][key]) for way in WAYS for key in ("mean", "max")]
    return max(*recorded, float(np.abs(one.vertices - other.vertices).max()))


# By item: what does the omitted work, and the bound of its difference in metres. The distance of a surface to itself is
# the rounding of nearest points.
ITEMS: dict[str, tuple[Callable[[Level], Level], float]] = {
    "decimation": (decimate_level, 0.0),
    "distance to the source": (measure_level, 1e-9),
}
