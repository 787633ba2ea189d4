"""Procedural objects as files: GLB, or OBJ with MTL and textures."""

import re
from pathlib import Path

import trimesh
from trimesh.exchange.obj import export_obj

from palpate.shapes.family import make


def suffix(index: int) -> str:
    """The format of object `index`: every third is an OBJ, the others are GLB."""
    return ".obj" if index % 3 == 2 else ".glb"


def write(class_name: str, index: int, path: Path | str, seed: int = 0) -> Path:
    """Write object `index` of a class and return the path of its mesh file.

    path: with suffix .glb or .obj; without a suffix, `suffix(index)` chooses. An OBJ has its MTL and
    its textures beside it, their names beginning with the file's stem. Equal arguments give equal bytes.
    """
    path = Path(path)
    if not path.suffix:
        path = path.with_name(path.name + suffix(index))
    scene = make(class_name, index, seed)
    if path.suffix == ".glb":
        path.write_bytes(scene.export(file_type="glb"))
    elif path.suffix == ".obj":
        write_obj(scene, path)
    else:
        raise ValueError(f"{path}: procedural objects are written as .glb or .obj")
    return path


def write_obj(scene: trimesh.Scene, path: Path) -> None:
    """Write a scene as OBJ, with MTL and textures named after it; `Pm` and `Pr` keep what trimesh does not write."""
    also = {}
    for mesh in scene.geometry.values():
        material = mesh.visual.material
        material.name = f"{path.stem}-{material.name}"
        also[material.name] = f"\nPm {material.metallicFactor:g}\nPr {material.roughnessFactor:g}".encode()
    text, files = export_obj(
        scene, include_normals=False, return_texture=True, mtl_name=f"{path.stem}.mtl", header=None
    )
    for name, data in files.items():
        if name.endswith(".mtl"):
            data = re.sub(rb"(?m)^newmtl (.+)$", lambda line: line[0] + also[line[1].decode()], data)
        (path.parent / name).write_bytes(data)
    path.write_text(text)
