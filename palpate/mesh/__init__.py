"""Mesh files of an object from a source file of any kind: loaded, repaired, normalised, decimated, measured."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from palpate.batch import UnusableObject
from palpate.mesh.isolation import isolated
from palpate.mesh.load import FORMATS

DIAGONAL = 0.5
OBJECT_POSITION = (0.0, 0.0, 0.6)

__all__ = [
    "DIAGONAL",
    "FORMATS",
    "OBJECT_POSITION",
    "load_collision",
    "load_visual",
    "prepare",
    "undecimated_levels",
]


def prepare(
    source: Path | str,
    folder: Path | str,
    up: str = "z",
    collision_faces: int = 4000,
    levels: Sequence[int] = (1000,),
    time_limit: float = 900.0,
) -> dict[str, Any]:
    """Make the mesh files of one object from a source file of any of `FORMATS`.

    Writes into the folder `visual.glb` (every face, materials and textures), `collision.ply` and
    `level-<faces>.ply` (decimated, geometry only), all in the object's own frame (metres, z up, bounding-box
    centre at the origin, diagonal `DIAGONAL`), and `mesh.json`: what was repaired, and how far each level is
    from the source. Returns what `mesh.json` holds. `up` is the source's up axis, "x", "y" or "z".
    A mesh that has no more faces than a level asks for is that level.

    Raises `UnusableObject` if the file can't be read or holds no surface, or takes more than `time_limit` seconds;
    OSError or MemoryError if the machine is at fault (a full disk, no memory).
    """
    source, folder = Path(source), Path(folder)
    # Imported here, in the parent of the child processes: stages that only load meshes need no pymeshlab.
    from palpate.mesh.build import build

    try:
        return isolated(build, source, folder, up, collision_faces, tuple(levels), seconds=time_limit)
    except UnusableObject as error:
        message = str(error)
        raise UnusableObject(message if str(source) in message else f"{source}: {message}") from None


def undecimated_levels(record: Mapping[str, Any]) -> dict[str, int]:
    """The levels whose finer mesh had no more faces than they ask for, and its faces; record: of `mesh.json`."""
    levels = {name: level for name, level in record.items() if isinstance(level, dict) and "asked" in level}
    faces, found = record["visual.glb"]["faces"], {}
    for name, level in sorted(levels.items(), key=lambda item: -item[1]["asked"]):
        if faces <= level["asked"]:
            found[name] = faces
        faces = level["faces"]
    return found


def load_visual(folder: Path | str) -> trimesh.Trimesh:
    """The geometry of `visual.glb`, every face, as one mesh in the object's own frame, without materials."""
    loaded = trimesh.load_scene(Path(folder) / "visual.glb", process=False, skip_materials=True)
    parts = list(loaded.geometry.values())
    start = np.cumsum([0] + [len(part.vertices) for part in parts])
    return trimesh.Trimesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + first for part, first in zip(parts, start, strict=False)]),
        process=False,
        validate=False,
    )


def load_collision(folder: Path | str) -> trimesh.Trimesh:
    """`collision.ply`, the decimated surface, in the object's own frame."""
    return trimesh.load_mesh(Path(folder) / "collision.ply", process=False)
