"""Which of several files of one object says most about it, and the files that an object's files name.

No mesh is loaded: heads and material libraries are read as text.
"""

import re
from pathlib import Path

from palpate import named_files
from palpate.named_files import HEAD, IMAGES
from palpate.released import layout


def companions(path: Path, root: Path | str | None = None, head: int = -1) -> list[str]:
    """As `palpate.named_files.companions`; of a released surface the object's images and scenes."""
    if path.suffix.lower() == ".npy":
        return sorted(name for name in layout.files(path) if (path.parent / name).is_file())
    return named_files.companions(path, root, head)


TEXTURE, COLOURS, SHAPE = 2, 1, 0


def richness(path: Path, root: Path | str | None = None) -> int:
    """How much a mesh file holds beside the shape: `TEXTURE`, `COLOURS` or `SHAPE`.

    A texture is an image that exists: one that the file names, or one within a glTF file. Colours are a material
    library that exists, materials of a glTF or COLLADA file, or colours at vertices or faces (PLY, OFF). A file that
    can't be read has `SHAPE`: the meshes stage says what is wrong with it. root: as for `companions`.
    """
    try:
        suffix = path.suffix.lower()
        named = companions(path, root, head=HEAD)
        if any(name.lower().endswith(IMAGES) for name in named):
            return TEXTURE
        if named_files.unusable(path):
            return SHAPE
        if suffix in (".glb", ".gltf"):
            tree, _ = named_files.gltf_tree(path, named_files.MOST)
            return TEXTURE if tree.get("images") else COLOURS if tree.get("materials") else SHAPE
        if suffix == ".obj":
            return COLOURS if named else SHAPE
        with open(path, "rb") as file:
            head = file.read(named_files.MOST if suffix == ".dae" else HEAD)
        colours = {
            ".ply": rb"property\s+\w+\s+(red|diffuse_red)\b",
            ".off": rb"\A\s*(COFF|CNOFF|STCOFF)",
            ".dae": rb"<library_materials",
        }.get(suffix)
        return COLOURS if colours and re.search(colours, head.partition(b"end_header")[0]) else SHAPE
    except (OSError, ValueError, AttributeError):
        return SHAPE
