"""What the making of meshes omits: levels of meshes that are small already are neither decimated nor measured."""

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

WHEN = "a mesh has no more faces than a level asks for"
# Metres. What is measured of a surface against itself is the rounding of the nearest points.
ROUNDING = 1e-9


class Level(NamedTuple):
    """collision.ply: vertices (n, 3), metres, and faces (f, 3); stated: its record in `mesh.json`."""

    vertices: np.ndarray
    faces: np.ndarray
    stated: dict[str, Any]


def omissions(run: Path, subjects: list[Subject], settings: Mapping) -> Iterator[Omission]:
    """Objects made anew from their own collision meshes, which are as small as is asked for.

    settings: `mesh`. Read of the run: the objects' meshes.
    """
    asked = settings["mesh"]["collision_faces"]
    for subject in subjects:
        source = subject.folder / "collision.ply"
        faces = max(asked, len(mesh.load_collision(subject.folder).faces))
        make = partial(made, source, faces)
        for item, (omitted, difference) in ITEMS.items():
            yield Omission(
                stage="mesh",
                item=item,
                when=WHEN,
                object=subject.name,
                with_it=lambda make=make, omitted=omitted: omitted(make()),
                without=make,
                difference=difference,
                unit="m",
                bound=ROUNDING if item == "distance to the source" else 0.0,
            )


def made(source: Path, faces: int) -> Level:
    """The collision mesh of an object, of at most so many faces, as the workflow's stage makes it."""
    with tempfile.TemporaryDirectory() as folder:
        record = mesh.prepare(source, folder, collision_faces=faces, levels=())
        level = trimesh.load_mesh(Path(folder) / "collision.ply", process=False)
    return Level(np.asarray(level.vertices), np.asarray(level.faces), record["collision.ply"])


def decimated(level: Level) -> Level:
    """A level after a decimation to the faces that it is asked to have at most."""
    vertices, faces = collapse(level.vertices, level.faces, level.stated["asked"])
    return level._replace(vertices=vertices, faces=faces)


def measured(level: Level) -> Level:
    """A level with its distance to the mesh that it is, measured as that of any other level."""
    surface = Surface(level.vertices, level.faces)
    distances = {"source_to_level": distance(surface, surface), "level_to_source": distance(surface, surface)}
    return level._replace(stated=level.stated | distances)


def apart(one: Level, other: Level) -> float:
    """Metres between the vertices of two levels; infinite if their faces are not the same."""
    if one.vertices.shape != other.vertices.shape or not np.array_equal(one.faces, other.faces):
        return np.inf
    return float(np.abs(one.vertices - other.vertices).max())


def misstated(one: Level, other: Level) -> float:
    """Metres between what is stated of two levels' distances to the source, at most."""
    return max(
        abs(one.stated[way][key] - other.stated[way][key])
        for way in ("source_to_level", "level_to_source")
        for key in ("mean", "max")
    )


# What is omitted, what does it all the same, and how results differ.
ITEMS: dict[str, tuple[Callable[[Level], Level], Callable[[Level, Level], float]]] = {
    "decimation": (decimated, apart),
    "distance to the source": (measured, misstated),
}
