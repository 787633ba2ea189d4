"""What the making of meshes leaves out: the levels of meshes that are small already."""

import tempfile
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import trimesh

from palpate import mesh
from palpate.scene import Plan, plan
from studies.omitted.omission import Leaving
from studies.subjects import Subject

WHEN = "a mesh has no more faces than a level asks for"
# Metres. What is measured of a surface against itself is the rounding of the nearest points.
ROUNDING = 1e-9


class Level(NamedTuple):
    """collision.ply: vertices (n, 3), metres, and faces (f, 3); stated: what `mesh.json` says of it."""

    vertices: np.ndarray
    faces: np.ndarray
    stated: dict[str, Any]


def leavings(run: Path, subjects: list[Subject], settings: Mapping) -> Iterator[Leaving]:
    """Objects made anew from their own collision meshes, which are as small as is asked for.

    settings: `mesh`. Read of the run: the objects' meshes.
    """
    asked = settings["mesh"]["collision_faces"]
    for subject in subjects:
        source = subject.folder / "collision.ply"
        faces = len(mesh.load_collision(subject.folder).faces)
        less = plan("mesh", faces=faces, target=max(asked, faces))
        for part, difference in (("decimation", apart), ("distance to the source", misstated)):
            make = partial(made, source, max(asked, faces))
            yield Leaving(
                scene="mesh",
                part=part,
                when=WHEN,
                object=subject.name,
                with_it=partial(make, less.including(part)),
                without=partial(make, less),
                difference=difference,
                unit="m",
                bound=ROUNDING if part == "distance to the source" else 0.0,
                left_out=part in less.left_out,
            )


def made(source: Path, faces: int, plan: Plan) -> Level:
    """The collision mesh of an object, of at most so many faces, as the workflow's stage makes it."""
    with tempfile.TemporaryDirectory() as folder:
        record = mesh.prepare(source, folder, collision_faces=faces, levels=(), plan=plan)
        level = trimesh.load_mesh(Path(folder) / "collision.ply", process=False)
    return Level(np.asarray(level.vertices), np.asarray(level.faces), record["collision.ply"])


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
