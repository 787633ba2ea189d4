"""The files that a mesh file names, and which of several files of one object says most about it.

No mesh is loaded: heads and material libraries are read as text.
"""

import io
import json
import re
from pathlib import Path
from urllib.parse import unquote

from palpate.released import layout

# Google Scanned Objects, as Gazebo's models, have their textures here, seen from the mesh's folder. As
# `palpate.mesh.textures.FOLDERS`; repeated because that import loads mesh libraries.
TEXTURE_FOLDERS = (".", "../materials/textures")
IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".tga", ".gif", ".webp")  # as `palpate.mesh.textures`
HEAD = 65536  # bytes of a mesh file in which an OBJ names its libraries, and a PLY its properties


def companions(path: Path, head: int = -1) -> list[str]:
    """The files, relative to the mesh's folder and sorted, that a mesh file names and that exist: an OBJ's
    material libraries and their textures, a glTF's buffers and images, a COLLADA file's images; of a released
    surface the object's images and scenes.

    head: read only so many bytes of an OBJ, which can be long and names its libraries at the top as a rule;
    -1: all of it.
    """
    suffix = path.suffix.lower()
    if suffix == ".obj":
        libraries = _existing(path.parent, _obj_libraries(path, head))
        names = libraries + [name for library in libraries for name in _textures(path.parent / library)]
    elif suffix == ".gltf":
        names = _gltf_uris(path)
    elif suffix == ".dae":
        text = path.read_text(errors="replace")
        names = [unquote(name) for name in re.findall(r"<init_from>\s*(?:<ref>)?([^<]+?)\s*<", text)]
    elif suffix == ".npy":
        names = layout.files(path)
    else:
        return []
    return sorted(set(_existing(path.parent, names)))


def _obj_libraries(path: Path, head: int) -> list[str]:
    with open(path, "rb") as file:
        return [
            line[7:].decode(errors="replace").strip()
            for line in (file if head < 0 else io.BytesIO(file.read(head)))
            if line.startswith((b"mtllib ", b"mtllib\t"))
        ]


def _textures(library: Path) -> list[str]:
    """What the map statements may name: options stand before the file, whose name may have spaces."""
    statements = re.findall(
        r"^\s*(?:map_\w+|bump|disp|decal|refl|norm)\s+(.+?)\s*$",
        library.read_text(errors="replace"),
        re.MULTILINE | re.IGNORECASE,
    )
    words = [statement.split(" ") for statement in statements]
    return [" ".join(each[i:]) for each in words for i in range(len(each))]


def _gltf_uris(path: Path) -> list[str]:
    try:
        tree = json.loads(path.read_text(errors="replace"))
        items = [*tree.get("buffers", []), *tree.get("images", [])]
        return [unquote(item["uri"]) for item in items if not item.get("uri", "data:").startswith("data:")]
    except (ValueError, AttributeError, TypeError):
        return []  # damaged: the meshes stage says so


def _existing(folder: Path, names: list[str]) -> list[str]:
    """Of each name the first place of `TEXTURE_FOLDERS` that has it; names that none has are omitted."""
    places = [[Path(place, name).as_posix() for place in TEXTURE_FOLDERS] for name in names if name]
    return [found for found in (next((p for p in of if (folder / p).is_file()), None) for of in places) if found]


TEXTURE, COLOURS, SHAPE = 2, 1, 0


def richness(path: Path) -> int:
    """How much a mesh file holds beside the shape: `TEXTURE`, `COLOURS` or `SHAPE`.

    A texture is an image that exists: one that the file names, or one within a glTF file. Colours are a material
    library that exists, materials of a glTF or COLLADA file, or colours at vertices (PLY, OFF). A file that can't be
    read has `SHAPE`: the meshes stage says what is wrong with it.
    """
    try:
        suffix = path.suffix.lower()
        named = companions(path, head=HEAD)
        if any(name.lower().endswith(IMAGES) for name in named):
            return TEXTURE
        with open(path, "rb") as file:
            head = file.read(HEAD)
        if suffix == ".glb":
            length = int.from_bytes(head[12:16], "little")  # of the JSON chunk, which is the first (glTF 2.0, 4.4)
            with open(path, "rb") as file:
                head = file.read(20 + length)[20:]
        if suffix in (".glb", ".gltf"):
            tree = json.loads(head if suffix == ".glb" else path.read_bytes())
            return TEXTURE if tree.get("images") else COLOURS if tree.get("materials") else SHAPE
        if suffix == ".ply":
            head = head.partition(b"end_header")[0]
        has_colours = {
            ".obj": bool(named),
            ".ply": re.search(rb"property\s+\w+\s+(red|diffuse_red)\b", head),
            ".off": head.lstrip().startswith((b"COFF", b"CNOFF", b"STCOFF")),
            ".dae": b"<library_materials" in path.read_bytes() if suffix == ".dae" else False,
        }
        return COLOURS if has_colours.get(suffix) else SHAPE
    except (OSError, ValueError, AttributeError):
        return SHAPE
