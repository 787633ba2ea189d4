"""The procedural classes; objects by class and index, as scenes and as files: GLB, or OBJ with MTL and textures."""

import re
from pathlib import Path

import trimesh
from trimesh.exchange.obj import export_obj

from palpate.shapes import CLASSES, bottle, cellphone, knife, rifle, suffix
from palpate.shapes.assembly import assemble
from palpate.shapes.parameters import draw, read, style_and_rng

# A module has AXES (the long one, that towards which objects bend) and build(parameters, rng).
FAMILIES = dict(zip(CLASSES, (bottle, knife, cellphone, rifle), strict=True))


def make(class_name: str, index: int, seed: int = 0) -> trimesh.Scene:
    """Build object `index` of a class: a scene of closed meshes, one a material, of 5,000 to 50,000 faces; metres, z
    up. The same arguments give the same object. Raises ValueError for an unknown class or a negative index."""
    name, rng = style_and_rng(class_name, index, seed)
    family, p = FAMILIES[class_name], draw(rng, name, **read(class_name))
    waves = int(rng.integers(2**32))
    return assemble(family.build(p, rng), p, family.AXES, waves)


def write(class_name: str, index: int, path: Path | str, seed: int = 0) -> Path:
    """Write object `index` of a class and return the path of its mesh file; equal arguments give equal bytes.

    path: with suffix .glb or .obj; without a suffix, `suffix(index)` chooses. An OBJ has its MTL and textures beside
    it, named after it.
    """
    path = Path(path)
    if not path.suffix:
        path = path.with_name(path.name + suffix(index))
    if path.suffix not in (".glb", ".obj"):
        raise ValueError(f"{path}: procedural objects are written as .glb or .obj")
    scene, also = make(class_name, index, seed), {}
    if path.suffix == ".glb":
        path.write_bytes(scene.export(file_type="glb"))
        return path
    for mesh in scene.geometry.values():
        material = mesh.visual.material
        material.name = f"{path.stem}-{material.name}"
        # What trimesh does not write.
        also[material.name] = f"\nPm {material.metallicFactor:g}\nPr {material.roughnessFactor:g}".encode()
    options = {"include_normals": False, "return_texture": True, "mtl_name": f"{path.stem}.mtl", "header": None}
    text, files = export_obj(scene, **options)
    for name, data in files.items():
        if name.endswith(".mtl"):
            data = re.sub(rb"(?m)^newmtl (.+)$", lambda line: line[0] + also[line[1].decode()], data)
        (path.parent / name).write_bytes(data)
    path.write_text(text)
    return path
