"""The files that a mesh file names: which they are, where they are, how large their pictures are.

No mesh is loaded. Reading takes time in proportion to the file, of which no more than `MOST` bytes are searched. Names
that can't be a file's, and what is no regular file (a pipe, a device), count as missing.

obj: material libraries, and the textures that these name. gltf, glb: buffers and images. dae: images. ply: textures
(`comment TextureFile`). stl, off, 3mf: none.
"""

import contextlib
import io
import json
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import unquote

IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".tga", ".gif", ".webp")
# Seen from the mesh file's folder: beside it, and where Gazebo's models have them, as Google's scanned objects.
FOLDERS = (".", "../materials/textures")
MOST = 64 << 20  # bytes of a file that are searched for names
HEAD = 65536  # bytes of a file in which an OBJ names its libraries as a rule, and a PLY its textures
SMALL = 16384  # bytes of a picture's file: of one colour, a smaller one has at most 16 million pixels
LONGEST = 4096  # bytes of a path, at most, on Linux
LARGEST_SIDE = 16384  # pixels: the largest that common GPUs take as a texture
NAME = rb"([^\r\n]{1,%d})" % LONGEST
PATTERNS = {
    ".obj": re.compile(rb"\nmtllib[ \t]+" + NAME),
    ".mtl": re.compile(rb"[\r\n][ \t]*(?:map_\w+|bump|disp|decal|refl|norm)[ \t]+" + NAME, re.IGNORECASE),
    ".gltf": re.compile(rb'"uri"\s*:\s*"(?!data:)([^"]{1,%d})"' % LONGEST),
    ".dae": re.compile(rb"<init_from>\s*(?:<ref>)?([^<]{1,%d})<" % LONGEST),
    ".ply": re.compile(rb"\ncomment[ \t]+texturefile[ \t]+" + NAME, re.IGNORECASE),
}


def unusable(path: Path | str) -> str:
    """Why a path can't be a mesh's, whatever the file holds; empty if it can, or if there is no such file."""
    if "\\udc" in str(path):  # as `palpate.catalogue` has bytes that are not UTF-8
        return "its name is not UTF-8: rename it"
    special = os.path.exists(path) and not os.path.isfile(path)
    return "it is a folder, a pipe or a device, not a regular file: remove it" if special else ""


def companions(path: Path, root: Path | str | None = None, head: int = -1) -> list[str]:
    """The files, relative to the mesh's folder and sorted, that a mesh file names and that exist below root.

    root: as for `find`. head: read only so many bytes of an OBJ, which can be long; -1: all of it.
    """
    if path.suffix.lower() not in (*PATTERNS, ".glb") or unusable(path) or not path.is_file():
        return []

    def existing(file: Path, suffix: str) -> list[str]:
        most = {".obj": head, ".ply": HEAD}.get(suffix, MOST)
        return [found for name in _names(file, suffix, most) if (found := find(path, name, root))]

    found = existing(path, path.suffix.lower())
    if path.suffix.lower() == ".obj":
        found += [name for library in found for name in existing(path.parent / library, ".mtl")]
    return sorted(set(found))


def _names(path: Path, suffix: str, most: int) -> set[str]:
    with open(path, "rb") as file:
        if suffix == ".glb":
            most, suffix = min(int.from_bytes(file.read(20)[12:16], "little"), MOST), ".gltf"
        data = b"\n" + file.read(most)
    if suffix == ".ply":
        data = data.partition(b"end_header")[0]
    return {_text(name) for name in PATTERNS[suffix].findall(data)}


def _text(name: bytes) -> str:
    """A name as text: in UTF-8 or else Latin-1, with JSON's escapes of single characters resolved."""
    try:
        text = name.decode()
    except UnicodeDecodeError:
        text = name.decode("latin-1")
    return re.sub(r"(?:\\u[0-9a-fA-F]{4})+", lambda match: json.loads(f'"{match[0]}"'), text)


def find(path: Path, name: str, root: Path | str | None = None) -> str | None:
    """A file that a mesh file names, relative to the mesh's folder; None if there is none, or outside the root.

    The first that exists of: the name in `FOLDERS`, with URI escapes and the options of MTL's statements taken off,
    without a leading slash, and its last part beside the mesh. root: the folder that it has to be in; default: the one
    above the mesh's. Links on the way to the mesh, and within the folders that it names, may lead anywhere.
    """
    places = (place for place in _places(name) if os.path.isfile(path.parent / place))
    return next((place for place in places if _inside(path, place, root)), None)


def is_outside(path: Path, name: str, root: Path | str | None = None) -> bool:
    """Whether a file that a mesh file names exists, but outside the root of `find`."""
    return find(path, name, root) is None and find(path, name, "/") is not None


def _places(name: str) -> Iterator[str]:
    text = name.strip().replace("\\", "/")
    if len(text) > LONGEST:
        return
    words = text.split(" ")
    for start in range(min(len(words), 32) if text.startswith("-") else 1):
        rest = " ".join(words[start:])
        for each in dict.fromkeys((rest, unquote(rest))):
            for place in (
                *(PurePosixPath(folder, each) for folder in FOLDERS),
                each.lstrip("/"),
                os.path.basename(each),
            ):
                yield str(place)


def _inside(path: Path, place: str, root) -> bool:
    if not place.startswith("/") and ".." not in place.split("/"):
        return True
    folder = Path(os.path.abspath(path.parent))
    root = Path(os.path.abspath(root)) if root else folder.parent
    real = os.path.realpath(folder / place)
    bases = {os.path.realpath(each) for each in (folder, *folder.parents, root) if each == root or root in each.parents}
    return any(os.path.commonpath((real, base)) == base for base in bases)


def texture_pixels(path: Path, root: Path | str | None = None) -> int:
    """Pixels of all pictures that a mesh file names, or holds (.glb), by their heads; 0 of those that can't be used."""
    import PIL.Image  # the workflow plans without it, as a rule

    PIL.Image.MAX_IMAGE_PIXELS = LARGEST_SIDE**2  # PIL refuses twice as many; by itself it refuses 16k textures
    files = [path.parent / name for name in companions(path, root, HEAD) if name.lower().endswith(IMAGES)]
    files = [file for file in files if os.path.getsize(file) > SMALL]
    if path.suffix.lower() == ".glb" and not unusable(path):
        with contextlib.suppress(OSError, ValueError):
            files += [
                io.BytesIO(head)
                for _, head in held_pictures(path, *gltf_tree(path, MOST), 1 << 20)
                if len(head) > SMALL
            ]
    total = 0
    for each in files:
        try:
            with PIL.Image.open(each) as image:
                width, height = image.size
        except Exception:  # whatever a broken file makes a reader trip over: the meshes stage names it
            continue
        total += width * height if max(width, height) <= LARGEST_SIDE else 0
    return total


def held_pictures(path: Path, tree: Mapping[str, Any], start: int, most: int | None = None) -> list[tuple[int, bytes]]:
    """Numbers and bytes (`most` of each) of the pictures within a .glb file; tree, start: as `gltf_tree` gives them.

    Raises ValueError if the file is damaged.
    """
    found = []
    try:
        with open(path, "rb") as file:
            for number, image in enumerate(tree.get("images", [])):
                if "bufferView" in image:
                    view = tree["bufferViews"][image["bufferView"]]
                    file.seek(start + view.get("byteOffset", 0))
                    found.append((number, file.read(min(view["byteLength"], most or view["byteLength"]))))
    except (LookupError, TypeError, AttributeError) as error:
        raise ValueError(str(error)) from None
    return found


def gltf_tree(path: Path, most: int | None = None) -> tuple[dict[str, Any], int]:
    """The JSON of a .gltf or .glb file, and where a .glb's binary data begin.

    Raises ValueError if it is damaged, nested too deep, or longer than `most` bytes.
    """
    length = start = 0
    with open(path, "rb") as file:
        if path.suffix.lower() == ".glb":
            start, length = 20, int.from_bytes(file.read(20)[12:16], "little")  # JSON comes first (glTF 2.0, 4.4)
        file.seek(start)
        text = file.read(min(each for each in (length, most) if each) if length or most else -1)
    try:
        tree = json.loads(text)
    except RecursionError:
        raise ValueError("its JSON is nested too deep") from None
    if not isinstance(tree, dict):
        raise ValueError("its JSON is not an object")
    return tree, start + length + 8
