"""Mesh files of an object from a source file of any kind: loaded, repaired, normalised, decimated, measured."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from palpate import seal
from palpate.batch import UnusableObject
from palpate.mesh.isolation import isolated
from palpate.named_files import gltf_tree

if TYPE_CHECKING:
    import trimesh

FORMATS = ("obj", "glb", "gltf", "stl", "ply", "off", "dae", "3mf")
DIAGONAL = 0.5  # m, of the bounding boxes of objects that are scaled to one size, as the paper's
SMALLEST, LARGEST = 0.005, 2.0  # m, diagonals: an object that keeps its size and has another is in another unit
OBJECT_POSITION = (0.0, 0.0, 0.6)
MAX_DEVIATION = 0.002  # m that the surface of `collision.ply` may be from that of `visual.glb`
TIME_LIMIT = 900.0  # s, for the mesh files of one object
VERSION = 4  # of the files, in `mesh.json` and in the rule's params: meshes of an older version are made again
FACTS = ".facts.json"  # after the name of a batch's folder: `facts` of its objects, beside it


def prepare(
    source: Path | str,
    folder: Path | str,
    up: str = "z",
    collision_faces: int = 4000,
    scale: str | float = "diagonal",
    root: Path | str | None = None,
    turn: float = 0.0,
) -> dict[str, Any]:
    """Make `visual.glb` (every face, materials and textures), `collision.ply` (decimated, geometry only), both in the
    object's own frame (metres, z up, bounding-box centre at the origin), and `mesh.json`, whose content is returned.

    source: of any of `FORMATS`. up: its up axis, "x", "y" or "z". turn: degrees about the vertical, after that. scale:
    "diagonal" for a bounding box with the diagonal `DIAGONAL`, "keep" for a file in metres, or the metres of a unit of
    the file. root: the folder that textures and buffers have to be in; default: the one above the file's own.

    Raises `UnusableObject` if the file can't be read, holds no surface, takes more than `TIME_LIMIT` seconds, or is not
    `SMALLEST` to `LARGEST` across at its scale; OSError or MemoryError for a full disk or lack of memory.
    """
    from palpate.mesh.build import build  # in the parent of the child processes

    try:
        return isolated(build, Path(source), Path(folder), up, collision_faces, scale, root, turn, seconds=TIME_LIMIT)
    except UnusableObject as error:
        message = str(error)
        raise UnusableObject(message if str(source) in message else f"{source}: {message}") from None


def facts(record: Mapping[str, Any]) -> dict[str, Any]:
    """An object's `problems` (named files and parts that can't be used, and what follows) and its `shape` (sides of the
    box, and the root of the area, in diagonals); record: of `mesh.json`."""
    low, high = np.array(record["visual.glb"]["bounding_box"])
    shape = [float(length) / record["diagonal"] for length in (*(high - low), record["visual.glb"]["area"] ** 0.5)]
    return {"problems": record["source"]["problems"], "shape": shape}


def read_record(folder: Path | str) -> dict[str, Any]:
    """What `mesh.json` holds; empty if a folder outside a run has none. Raises as `mesh_file` does."""
    path = mesh_file(folder, "mesh.json")
    return json.loads(path.read_text()) if path.exists() else {}


def mesh_file(folder: Path | str, name: str) -> Path:
    """Path of a file in an object's folder. Raises `palpate.seal.DamagedFile` if the batch has a seal, as in a run, and
    the file is missing or not the one that was written."""
    path, batch = Path(folder, name), Path(folder).parent
    if (batch / seal.NAME).exists():
        sealed, relative = seal.read(batch), f"{path.parent.name}/{name}"
        if relative not in sealed.files:
            raise seal.damaged(batch, f"{relative} was not written with it")
        sealed.require([relative])
    return path


def usable(batch: Path | str, contents: bool = False) -> list[str]:
    """Names of the objects that a run's batch of meshes holds, by its seal; contents: compare checksums of files, too.
    Raises `palpate.seal.DamagedFile`, naming files, if the seal or files are missing, of another size, or changed."""
    sealed = seal.read(batch)
    sealed.require(contents=contents)
    return list(dict.fromkeys(name.split("/")[0] for name in sealed.files if "/" in name))


class Geometry(NamedTuple):
    """Triangles of a mesh, in metres."""

    vertices: np.ndarray  # (n, 3) float64
    faces: np.ndarray  # (f, 3) int64


Mesh: TypeAlias = "Geometry | trimesh.Trimesh"  # what has vertices (n, 3) and faces (f, 3)


def load_geometry(folder: Path | str) -> Geometry:
    """Every face of `visual.glb` in the object's own frame, without trimesh: its import takes longer than sensing."""
    path = mesh_file(folder, "visual.glb")
    (tree, start), data = gltf_tree(path), path.read_bytes()

    def read(number: int, width: int) -> np.ndarray:
        accessor = tree["accessors"][number]
        dtype = {5125: "<u4", 5126: "<f4"}[accessor["componentType"]]
        view = tree["bufferViews"][accessor["bufferView"]]
        offset = start + view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        return np.frombuffer(data, dtype, accessor["count"] * width, offset).reshape(-1, 3)

    parts = [primitive for mesh in tree["meshes"] for primitive in mesh["primitives"]]
    vertices = [read(part["attributes"]["POSITION"], 3) for part in parts]
    first = np.cumsum([0, *map(len, vertices)])[:-1]
    faces = [read(part["indices"], 1) + number for part, number in zip(parts, first, strict=True)]
    return Geometry(np.concatenate(vertices).astype(float), np.concatenate(faces).astype(np.int64))


def load_visual(folder: Path | str) -> "trimesh.Trimesh":
    """`load_geometry` as one mesh of trimesh."""
    import trimesh

    return trimesh.Trimesh(*load_geometry(folder), process=False, validate=False)


def load_collision(folder: Path | str) -> "trimesh.Trimesh":
    """`collision.ply`, the decimated surface, in the object's own frame."""
    import trimesh

    return trimesh.load_mesh(mesh_file(folder, "collision.ply"), process=False)
