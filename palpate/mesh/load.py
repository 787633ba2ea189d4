"""Reading a mesh file of any supported format as a list of triangle meshes with their materials."""

import logging
from functools import partial
from importlib import import_module
from pathlib import Path

import numpy as np
import trimesh
import trimesh.path

from palpate.batch import UnusableObject
from palpate.mesh import FORMATS, textures
from palpate.mesh.files import Files
from palpate.mesh.integrity import check_sizes, check_whole
from palpate.mesh.materials import make_explicit
from palpate.mesh.part import Loaded
from palpate.mesh.recognise import UNREAD, what_it_is
from palpate.named_files import unusable

log = logging.getLogger(__name__)


# Readers by suffix, `palpate.mesh.formats.<module>.read`.
READERS: dict[str, str] = {
    ".3mf": "threemf",
    ".dae": "collada",
    ".off": "off",
    ".ply": "ply",
    ".stl": "stl",
}


def load(path: Path | str, root: Path | str | None = None) -> tuple[Loaded, dict[str, str]]:
    """Every triangle mesh of a file, placed as the file says, nothing repaired, and what is wrong with files and parts
    that it names, by their names.

    root: the folder that named files have to be in, as for `palpate.named_files.find`.
    Raises `UnusableObject` if the file can't be read, or holds no triangles, or refers to vertices that it lacks;
    MemoryError, naming the file, if there is too little memory for it.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix in UNREAD:
        raise UnusableObject("{}: {}: {}".format(path, *UNREAD[suffix]))
    if suffix.lstrip(".") not in FORMATS:
        raise UnusableObject(f"{path}: a mesh file ends in one of .{', .'.join(FORMATS)}: convert it to one of these")
    if problem := unusable(path):
        raise UnusableObject(f"{path}: {problem}")
    if not path.is_file():
        raise UnusableObject(f"{path}: there is no such file: correct the path or remove the object")
    if other := what_it_is(path):
        raise UnusableObject(f"{path}: can't be read as {suffix}: {other}")
    files = Files(path, root)
    try:
        if suffix in READERS:
            loaded = import_module(f"palpate.mesh.formats.{READERS[suffix]}").read(path, files)
        else:
            loaded = _read_with_trimesh(path, files)
    except MemoryError as error:  # says nothing about the object
        raise MemoryError(f"while loading {path}, {path.stat().st_size / 1e6:.0f} MB {error}".strip()) from None
    except Exception as error:  # the readers raise whatever a broken file makes them trip over
        kind = "" if isinstance(error, ValueError) else f"{type(error).__name__}: "
        raise UnusableObject(
            f"{path}: can't be read as {suffix} ({kind}{error}): export it again, or remove the object"
        ) from error
    parts = [part for part in loaded.parts if len(part.faces)]
    if not parts:
        raise UnusableObject(f"{path}: holds no triangles (points or lines only, or nothing): export its faces")
    for part in parts:
        if part.faces.min() < 0 or part.faces.max() >= len(part.vertices):
            raise UnusableObject(
                f"{path}: a face refers to vertex {part.faces.max()} of {len(part.vertices)}: "
                "the file is damaged, export it again"
            )
    return Loaded(parts, loaded.unit), files.problems


def _read_with_trimesh(path: Path, files: Files) -> Loaded:  # TODO goes, as soon as each format has its reader
    resolver = textures.Resolver(path, files.root)
    check_sizes(path)
    loaded = trimesh.load_scene(path, process=False, resolver=resolver)
    check_whole(path, loaded)
    problems, materials = textures.within(path)
    nodes = sorted(loaded.graph.nodes_geometry)
    meshes = [node for node in nodes if isinstance(loaded.geometry[loaded.graph[node][1]], trimesh.Trimesh)]
    parts = [part for part in (_placed(loaded, node) for node in meshes) if len(part.faces)]
    for part in parts:
        if part.visual.kind == "face":
            part.unmerge_vertices()
            part.metadata.pop("vertex_normals", None)
        textures.make_neutral(part, materials)
        make_explicit(part, path.suffix.lower())
    for name, problem in (problems | resolver.replaced).items():
        files.note(name, f"{problem}: drawn in neutral grey")
    return Loaded(parts)


def _placed(loaded: trimesh.Scene, node: str) -> trimesh.Trimesh:
    """A copy of the node's mesh in the frame of the file; its materials are shared, not copied."""
    transform, name = loaded.graph[node]
    mesh = loaded.geometry[name]
    normals = mesh._cache["vertex_normals"]  # only where the file gave them: computed ones are not wanted
    visual = mesh.visual
    with np.errstate(invalid="ignore", over="ignore"):  # vertices that are not finite are looked for later
        vertices = mesh.vertices @ transform[:3, :3].T + transform[:3, 3]
    placed = trimesh.Trimesh(vertices, mesh.faces, process=False, validate=False)
    placed.visual = visual if loaded.graph.nodes_geometry.count(node) == 1 else visual.copy()
    linear = transform[:3, :3]
    if np.linalg.det(linear) < 0:
        placed.faces = placed.faces[:, ::-1]
    if normals is not None and len(normals) == len(placed.vertices):
        placed.metadata["vertex_normals"] = np.asarray(normals) @ np.linalg.pinv(linear)
    placed.metadata["name"] = name
    material = getattr(placed.visual, "material", None)
    for name in ("image", "baseColorTexture", "metallicRoughnessTexture", "emissiveTexture", "normalTexture"):
        image = getattr(material, name, None)
        if image is not None and image.format == "JPEG" and "save" not in vars(image):
            image.save = partial(image.save, quality="keep")  # its own quantisation, not the writer's lower default
    return placed
