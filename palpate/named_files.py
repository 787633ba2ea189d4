"""What a mesh file is by its beginning, and the files that it names: which and where they are; no mesh is loaded. obj:
material libraries, and the textures that these name. gltf, glb: buffers and images. dae: images. ply: textures
(`comment TextureFile`). stl, off, 3mf: none. What is no regular file (a pipe, a device) counts as missing."""

import contextlib
import io
import json
import os
import re
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import unquote

from palpate.configuration import read_yaml

IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".tga", ".gif", ".webp")
# Seen from the mesh file's folder: beside it, and where Gazebo's models have them, as Google's scanned objects.
FOLDERS = (".", "../materials/textures")
MOST = 64 << 20  # bytes of a file that are searched for names
HEAD = 65536  # bytes of a file in which an OBJ names its libraries as a rule, and a PLY its textures
SMALL = 16384  # bytes of a picture's file: of one colour, a smaller one has at most 16 million pixels
LONGEST = 4096  # bytes of a path, at most, on Linux
LARGEST_SIDE = 16384  # pixels: the largest that common GPUs take as a texture
NAME = rb"([^\r\n]{1,%d})" % LONGEST
MTLLIB = re.compile(rb"\n[ \t]*mtllib[ \t]+" + NAME, re.IGNORECASE)
MAP = re.compile(r"map_\w+|bump|disp|decal|refl|norm")
CONTINUED = re.compile(rb"^(?![ \t]*#)(?:[^\n]*\\[ \t]*\n)+[^\n]*", re.MULTILINE)
# An option of an MTL's map statement: its values are numbers, or one word. What remains is the file's name.
OPTION = re.compile(r"(-[a-z]+)((?:\s+[-+]?\.?\d[\d.eE+-]*(?=\s)){1,3}|\s+\S+)\s+(?=\S)", re.IGNORECASE)
PATTERNS = {
    ".gltf": re.compile(rb'"uri"\s*:\s*"(?!data:)([^"]{1,%d})"' % LONGEST),
    ".dae": re.compile(rb"<init_from>\s*(?:<ref>)?([^<]{1,%d})<" % LONGEST),
    ".ply": re.compile(rb"\ncomment[ \t]+texturefile[ \t]+" + NAME, re.IGNORECASE),
}

_TABLES = read_yaml(Path(__file__).with_name("unread.yaml"))
# Name and remedy of formats that are not read, by suffix.
UNREAD: dict[str, tuple[str, str]] = {
    suffix: (name, remedy)
    for remedy, formats in _TABLES["unread"].items()
    for name, suffixes in formats.items()
    for suffix in suffixes.split()
}
_XML = r"(?:<\?xml[^>]*>\s*)?(?:<!--(?s:.*?)-->\s*)*"
_BEGINNINGS = [
    (re.compile(rf"\s*(?:{pattern.replace('%XML', _XML)})".encode()), meaning)
    for pattern, meaning in _TABLES["beginnings"]
]


def unusable(path: Path | str) -> str:
    """Why a path can't be a mesh's, whatever the file holds; empty if it can, or if there is no such file."""
    if "\\udc" in str(path):  # as `palpate.catalogue` has bytes that are not UTF-8
        return "its name is not UTF-8: rename it"
    special = os.path.exists(path) and not os.path.isfile(path)
    return "it is a folder, a pipe or a device, not a regular file: remove it" if special else ""


def what_it_is(path: Path | str) -> str:
    """What a file is by its content, and the remedy, if it is not what its suffix says; else empty."""
    suffix = Path(path).suffix.lower()
    with open(path, "rb") as file:
        head = file.read(4096).removeprefix(b"\xef\xbb\xbf")
    meaning = next((meaning for pattern, meaning in _BEGINNINGS if pattern.match(head)), suffix)
    if meaning == suffix or (suffix == ".3mf" and head[:2] == b"PK"):
        return ""
    if meaning in UNREAD:
        return "{} by its content: {}".format(*UNREAD[meaning])
    return f"{meaning[1:].upper()} by its content: rename it to {meaning}" if meaning[0] == "." else meaning


def companions(path: Path, root: Path | str | None = None, head: int = -1) -> list[str]:
    """The files, relative to the mesh's folder and sorted, that a mesh file names and that exist below root, as for
    `find`; head: read only so many bytes of an OBJ, which can be long; -1: all of it."""
    suffix = path.suffix.lower()
    if suffix not in (".obj", ".glb", *PATTERNS) or unusable(path) or not path.is_file():
        return []
    if suffix != ".obj":
        return sorted({place for name in _names(path, suffix) if (place := find(path, name, root))})
    with open(path, "rb") as file:
        lines = set(MTLLIB.findall(b"\n" + joined_lines(file.read(head))))
    names = {name for line in lines for name in library_names(path, text(line), root)}
    places = {place for name in names if (place := find(path, name, root))}
    for library in list(places):
        with open(path.parent / library, "rb") as file:
            statements = mtl_statements(file.read(MOST))
        textures = (map_statement(rest)[1] for word, rest in statements if MAP.fullmatch(word))
        places |= {place for name in textures if (place := find(path, beside(path, library, name, root), root))}
    return sorted(places)


def joined_lines(data: bytes) -> bytes:
    """The text of an OBJ or MTL without a byte order mark, UTF-16 as UTF-8, and with \\n at the ends of lines.
    Lines that are continued (\\) are joined, and blank ones follow, so that the numbers of lines stay."""
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        data = data.decode("utf-16", "replace").encode()
    data = data.removeprefix(b"\xef\xbb\xbf").rstrip(b"\x1a").replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    ends = re.compile(rb"\\[ \t]*\n")
    if not ends.search(data):
        return data
    return CONTINUED.sub(lambda match: ends.sub(b" ", match[0]) + b"\n" * match[0].count(b"\n"), data)


def mtl_statements(data: bytes) -> list[tuple[str, str]]:
    """The statements of an MTL: the first word in small letters, and the rest of the line."""
    words = (text(line).split(None, 1) for line in joined_lines(data).split(b"\n"))
    return [(word[0].lower(), word[1].strip() if len(word) > 1 else "") for word in words if word]


def library_names(path: Path, rest: str, root: Path | str | None = None) -> list[str]:
    """The names in an OBJ's `mtllib` statement: one, which may have spaces, or several that end in .mtl."""
    if find(path, rest, root):
        return [rest.strip()]
    return [name for name in re.split(r'(?i)(?<=\.mtl)"?\s+', without_comment(rest)) if name]


def map_statement(rest: str) -> tuple[dict[str, list[str]], str]:
    """Options with their values, and the file's name, of the rest of an MTL's map statement."""
    options, rest = {}, rest.strip()
    while len(rest) <= LONGEST and (match := OPTION.match(rest)):
        options[match[1].lower()] = match[2].split()
        rest = rest[match.end() :]
    return options, rest


def beside(path: Path, library: str, name: str, root: Path | str | None = None) -> str:
    """A texture's name in an MTL as `find` takes it: relative to the MTL's folder if it is there, else as it is."""
    within = os.path.join(os.path.dirname(library), name)
    return within if find(path, within, root) else name if find(path, name, root) else without_comment(name).strip('"')


def without_comment(rest: str) -> str:
    """The rest of a statement without the comment at its end."""
    return re.split(r"\s#", rest, maxsplit=1)[0].strip()


def _names(path: Path, suffix: str) -> set[str]:
    """The names of files in a mesh file of one of `PATTERNS`, or a GLB."""
    most = HEAD if suffix == ".ply" else MOST
    with open(path, "rb") as file:
        if suffix == ".glb":
            most, suffix = min(int.from_bytes(file.read(20)[12:16], "little"), MOST), ".gltf"
        data = b"\n" + file.read(most)
    if suffix == ".ply":
        data = data.partition(b"end_header")[0]
    names, escapes = map(text, PATTERNS[suffix].findall(data)), re.compile(r"(?:\\u[0-9a-fA-F]{4})+")  # JSON's
    return {escapes.sub(lambda match: json.loads(f'"{match[0]}"'), name) for name in names}


def text(name: bytes) -> str:
    """A name as text: in UTF-8 or else Latin-1."""
    try:
        return name.decode()
    except UnicodeDecodeError:
        return name.decode("latin-1")


def find(path: Path, name: str, root: Path | str | None = None) -> str | None:
    """A file that a mesh file names, relative to the mesh's folder; None if there is none, or outside the root (by
    default the folder above). Links may lead anywhere. The first that exists of: the name in `FOLDERS`, without a
    comment, quotes or URI escapes if need be, without a leading slash, and its last part beside the mesh."""
    plain = name.strip().replace("\\", "/")
    bare = without_comment(plain).strip('"')
    for form in dict.fromkeys((plain, bare, unquote(plain), unquote(bare))) if len(name) <= LONGEST else ():
        in_folders = (str(PurePosixPath(folder, form)) for folder in FOLDERS)
        for place in (*in_folders, form.lstrip("/"), os.path.basename(form)):
            if os.path.isfile(path.parent / place) and _inside(path, place, root):
                return place
    return None


def is_outside(path: Path, name: str, root: Path | str | None = None) -> bool:
    """Whether a file that a mesh file names exists, but outside the root of `find`."""
    return find(path, name, root) is None and find(path, name, "/") is not None


def _inside(path: Path, place: str, root: Path | str | None) -> bool:
    """Whether a place seen from the mesh's folder is below the root of `find`."""
    if not place.startswith("/") and ".." not in place.split("/"):
        return True
    folder = Path(os.path.abspath(path.parent))
    top = Path(os.path.abspath(root)) if root else folder.parent
    real = os.path.realpath(folder / place)
    above = [parent for parent in (folder, *folder.parents, top) if parent == top or top in parent.parents]
    return any(os.path.commonpath((real, base)) == base for base in map(os.path.realpath, above))


def texture_pixels(path: Path, root: Path | str | None = None) -> int:
    """Pixels of all pictures that a mesh file names, or holds (.glb), by their heads; 0 of those that can't be used."""
    import PIL.Image  # the workflow plans without it, as a rule

    PIL.Image.MAX_IMAGE_PIXELS = None  # sides are looked at instead; by itself PIL refuses textures of 16k
    named = [path.parent / name for name in companions(path, root, HEAD) if name.lower().endswith(IMAGES)]
    files: list[Path | io.BytesIO] = [file for file in named if os.path.getsize(file) > SMALL]
    if path.suffix.lower() == ".glb" and not unusable(path):
        with contextlib.suppress(OSError, ValueError, LookupError, TypeError, AttributeError), open(path, "rb") as glb:
            tree, start = gltf_tree(path, MOST)
            views = (tree["bufferViews"][image["bufferView"]] for image in tree["images"] if "bufferView" in image)
            for view in views:
                if view["byteLength"] > SMALL:
                    glb.seek(start + view.get("byteOffset", 0))
                    files.append(io.BytesIO(glb.read(min(view["byteLength"], 1 << 20))))
    total = 0
    for picture in files:
        # Whatever a broken file makes a reader trip over: the meshes stage names it.
        with contextlib.suppress(Exception), PIL.Image.open(picture) as image:
            total += image.width * image.height if max(image.size) <= LARGEST_SIDE else 0
    return total


def gltf_tree(path: Path, most: int | None = None) -> tuple[dict[str, Any], int]:
    """The JSON of a .gltf or .glb, and where a .glb's binary data begin; ValueError if damaged or over `most` bytes."""
    length = start = 0
    with open(path, "rb") as file:
        if path.suffix.lower() == ".glb":
            start, length = 20, int.from_bytes(file.read(20)[12:16], "little")  # JSON comes first (glTF 2.0, 4.4)
        file.seek(start)
        text = file.read(min(limit for limit in (length, most) if limit) if length or most else -1)
    try:
        tree = json.loads(text)
    except RecursionError:
        raise ValueError("its JSON is nested too deep") from None
    if not isinstance(tree, dict):
        raise ValueError("its JSON is not an object")
    return tree, start + length + 8
