"""Reading a mesh file of any supported format as a list of triangle meshes with their materials."""

import logging
from functools import partial
from pathlib import Path

import numpy as np
import trimesh
import trimesh.path

from palpate.batch import UnusableObject
from palpate.mesh import FORMATS, textures
from palpate.mesh.integrity import check_sizes, check_whole
from palpate.named_files import unusable

log = logging.getLogger(__name__)


def load_parts(
    path: Path | str, replaced: dict[str, str] | None = None, root: Path | str | None = None
) -> list[trimesh.Trimesh]:
    """Every triangle mesh of a file, placed by its scene graph, in the order of the nodes' names; nothing is repaired.

    A texture or material library that can't be used is neutral grey (`palpate.mesh.textures`); replaced gets what is
    wrong with it, by its name. root: the folder that named files have to be in, as for `palpate.named_files.find`.

    Raises `UnusableObject` if the file can't be read, or holds no triangles, or refers to vertices that it lacks;
    MemoryError, naming the file, if there is too little memory for it.
    """
    path = Path(path)
    if path.suffix.lower().lstrip(".") not in FORMATS:
        raise UnusableObject(f"{path}: a mesh file ends in one of .{', .'.join(FORMATS)}: convert it to one of these")
    if problem := unusable(path):
        raise UnusableObject(f"{path}: {problem}")
    if not path.is_file():
        raise UnusableObject(f"{path}: there is no such file: correct the path or remove the object")
    resolver = textures.Resolver(path, root)
    try:
        check_sizes(path)
        loaded = trimesh.load_scene(path, process=False, resolver=resolver)
        check_whole(path, loaded)
        problems, materials = textures.within(path)
    except MemoryError as error:  # says nothing about the object
        raise MemoryError(f"while loading {path}, {path.stat().st_size / 1e6:.0f} MB {error}".strip()) from None
    except Exception as error:  # the readers raise whatever a broken file makes them trip over
        raise UnusableObject(
            f"{path}: can't be read as {path.suffix.lower()} ({type(error).__name__}: {error}): "
            "export it again, or remove the object"
        ) from error
    nodes = sorted(loaded.graph.nodes_geometry)
    meshes = [node for node in nodes if isinstance(loaded.geometry[loaded.graph[node][1]], trimesh.Trimesh)]
    parts = [part for part in (_placed(loaded, node) for node in meshes) if len(part.faces)]
    if not parts:
        loose = (trimesh.PointCloud, trimesh.path.Path2D, trimesh.path.Path3D)
        points = any(isinstance(geometry, loose) for geometry in loaded.geometry.values())
        contents = "points or lines only" if points else "nothing"
        raise UnusableObject(f"{path}: holds {contents}, no triangles: export the object's faces")
    for part in parts:
        if part.faces.min() < 0 or part.faces.max() >= len(part.vertices):
            raise UnusableObject(
                f"{path}: a face refers to vertex {part.faces.max()} of {len(part.vertices)}: "
                "the file is damaged, export it again"
            )
        textures.make_neutral(part, materials)
    problems |= resolver.replaced
    for name, problem in problems.items():
        log.warning("%s: %s: %s: drawn in neutral grey", path, name, problem)
    if replaced is not None:
        replaced |= problems
    return parts


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
