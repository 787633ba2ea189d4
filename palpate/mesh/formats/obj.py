"""Wavefront OBJ with its material libraries (MTL), mostly as Blender takes them: one part a material.

`Kd` is linear light. Under a texture it does not count: many exporters leave a dark one there. `Pr` is the roughness,
else sqrt(Ns / 1000) less than 1; `Pm` is metallic. Colours of vertices are sRGB, and count where there is no material.
Points, lines and curves have no surface.
"""

import re
from array import array
from itertools import chain, repeat
from pathlib import Path
from typing import Any

import numpy as np
from trimesh.visual.material import PBRMaterial
from trimesh.visual.texture import unmerge_faces

from palpate import named_files
from palpate.mesh.part import DRAWN_GREY, GREY, PLAIN, Files, Loaded, eight_bit, linear, make_part, plain
from palpate.mesh.polygons import triangulate
from palpate.named_files import text, without_comment

# How many numbers follow a keyword. After a position: its weight, or a colour, or a colour and its opacity.
COUNTS = {b"v": (3, 4, 6, 7), b"vt": (1, 2, 3), b"vn": (3,)}
CORNER = re.compile(rb"(\d{1,18})(?:/(\d{1,18})?(?:/(\d{1,18})?)?)?")
NONE = -2  # of a corner without a texture coordinate or a normal
# Statements that make no surface.
IGNORED = re.compile(
    "g|o|s|p|l|vp|mg|lod|curv2?|cstype|deg|bmat|step|parm|trim|hole|scrv|sp|end|con|cdc|cdp|res|bevel|[cd]_interp"
    "|[cs]tech|usemap|maplib|shadow_obj|trace_obj"
)

# Of materials by name: the place of the library, and the statements by their first words.
Definitions = dict[str, tuple[str, dict[str, str]]]


def read(path: Path, files: Files) -> Loaded:
    """An OBJ's polygons as triangles, the parts sorted by material. Raises ValueError, which names the line."""
    lines = named_files.joined_lines(path.read_bytes()).split(b"\n")
    (positions, uv, normals), words, faces, materials, statements = _statements(lines, files)
    corners, order = _corners(words, faces, (len(positions), len(uv), len(normals)), lines, files)
    vertices, colours = _vertices(positions, files)
    uv = np.nan_to_num(uv[:, :2], posinf=0, neginf=0)  # 0 where a line has u alone
    names = (name for rest in statements for name in named_files.library_names(path, rest, files.root))
    libraries = list(dict.fromkeys(names))
    definitions = _definitions(path, libraries, files, colours is not None)
    materials = [name if name in definitions else without_comment(name) for name in materials]
    used, index = np.unique(materials, return_inverse=True)

    triangles, polygon = triangulate(vertices, corners[order, 0], faces[:, 1])
    triangles = order[triangles]
    given = (corners[:, 1:] != NONE)[triangles].all(axis=1)  # (t, 2): texture coordinates, normals
    key = 4 * index[faces[polygon, 2]] + given @ (2, 1)
    vertex_of, parts = np.empty(len(corners), np.int64), []
    for number in np.unique(key):
        name, mine = str(used[number // 4]), triangles[key == number]
        has = np.array((1, number & 2, number & 1), dtype=bool)
        corner = np.unique(mine)
        new, *rows = unmerge_faces(*np.where(has, corners[corner], NONE).T[:, :, None])
        vertex_of[corner] = new[:, 0]
        material, coordinates, wrap = None, uv[rows[1]] if has[1] else None, None
        if name in definitions:
            material, coordinates, wrap = _material(name, *definitions[name], coordinates, path, files)
        elif name and libraries and colours is None:
            material = plain(GREY, name)
            if not files.problems.keys() & set(libraries):
                files.note(name, f"no material library has it: {DRAWN_GREY}")
        more: dict[str, Any] = {"normals": normals[rows[2], :3] if has[2] else None, "uv": coordinates, "wrap": wrap}
        if material is None and colours is not None:
            missing = np.isnan(colours[rows[0]]).any(axis=1)
            light = linear(eight_bit(colours[rows[0]]))
            light[missing, :3] = round(255 * PLAIN)  # of single vertices without one
            more["colours"] = None if missing.all() else light
        parts.append(make_part(name or path.name, vertices[rows[0]], vertex_of[mine], material, **more))
    return Loaded(parts)


def _statements(
    lines: list[bytes], files: Files
) -> tuple[list[np.ndarray], list[bytes], np.ndarray, list[str], list[str]]:
    """Tables of positions, texture coordinates and normals (n, 7), NaN where a line has fewer numbers; the texts of the
    corners of all faces, one after the other; the faces (f, 3): number of the line, corners and material; the names of
    materials; what each `mtllib` says. Raises ValueError with the first line that can't be read."""
    tables = {keyword: (array("d"), array("B")) for keyword in COUNTS}  # their numbers, and how many a line has
    corners: list[bytes] = []
    faces: list[int] = []
    materials, libraries, material = {"": 0}, [], 0
    for number, line in enumerate(lines):
        words = (line.partition(b"#")[0] if b"#" in line else line).split()
        if not words:
            continue
        keyword = words.pop(0).lower()
        try:
            if keyword in tables:
                values, counts = tables[keyword]
                if len(words) not in COUNTS[keyword]:
                    raise ValueError(f"it has {len(words)} numbers, not {' or '.join(map(str, COUNTS[keyword]))}")
                values.extend(map(float, words))
                counts.append(len(words))
            elif keyword in (b"f", b"fo"):  # fo: of old files
                if b"-" in line:  # negative numbers count back from here; 0 is before the first
                    sizes = [len(counts) for _, counts in tables.values()]
                    for place, word in enumerate(words):
                        parts = zip(word.split(b"/"), chain(sizes, repeat(0)), strict=False)
                        from_start = (b"%d" % max(0, int(k) + n + 1) if k.startswith(b"-") else k for k, n in parts)
                        words[place] = b"/".join(from_start)
                corners += words
                faces += (number, len(words), material)
            elif keyword == b"usemtl":
                material = materials.setdefault(" ".join(text(line).split()[1:]), len(materials))
            elif keyword == b"mtllib":
                libraries += text(line).split(None, 1)[1:]
            elif not IGNORED.fullmatch(text(keyword)):
                if not re.fullmatch(b"[a-z_]+2?", keyword):
                    raise ValueError("it is no statement of an OBJ")
                files.note(text(keyword), "such statements are not read: left out")
        except ValueError as error:
            raise _error(number, line, error) from None
    if faces[-3:-2] == [len(lines) - 1]:  # the last line, which has no end
        slashes = {word.count(b"/") + word.endswith(b"/") for word in words}
        if len(words) < 3 or len(slashes) > 1:
            raise _error(number, line, "the file is cut off within this face")
    numbers = []
    for values, counts in tables.values():
        numbers.append(np.full((len(counts), 7), np.nan))
        numbers[-1][np.arange(7) < np.array(counts)[:, None]] = values
    return numbers, corners, np.array(faces, dtype=np.int64).reshape(-1, 3), list(materials), libraries


def _error(number: int, line: bytes, problem: object) -> ValueError:
    """The error about a line, by its number from 0."""
    return ValueError(f"line {number + 1}, {' '.join(text(line).split())[:80]!r}: {problem}")


def _corners(
    words: list[bytes], faces: np.ndarray, sizes: tuple[int, int, int], lines: list[bytes], files: Files
) -> tuple[np.ndarray, np.ndarray]:
    """The corners that differ (c, 3), vertex, texture coordinate and normal or `NONE`, also where the file has none
    of a kind, and which of them each corner of the faces is. Raises ValueError, with the line, for others."""
    number_of = {word: number for number, word in enumerate(dict.fromkeys(words))}
    order = np.fromiter(map(number_of.get, words), np.int64, len(words))

    def error(wrong: np.ndarray, problem: str) -> ValueError:
        place, ends = np.argmax(wrong[order]), np.cumsum(faces[:, 1])
        number, count, _ = faces[face := np.searchsorted(ends, place, side="right")]
        word = text(lines[number].split()[1 + count - ends[face] + place])
        return _error(number, lines[number], f"{word!r} {problem}")

    wrong = np.array([CORNER.fullmatch(word) is None for word in number_of], dtype=bool)
    if wrong.any():
        raise error(wrong, "is no corner")
    numbers = [number for word in number_of for number in (word + b"//").split(b"/")[:3]]
    corners = np.array([int(number) - 1 if number else NONE for number in numbers], dtype=np.int64).reshape(-1, 3)
    for value, name, size in zip(corners.T, ("vertex", "texture coordinate", "normal"), sizes, strict=True):
        wrong = (value != NONE) & ((value < 0) | (value >= size))
        if wrong.any() and not size and name != "vertex":
            files.note(f"{name}s", "faces name some, and the file has none: left out")
            value[:] = NONE
        elif wrong.any():
            raise error(wrong, f"names a {name} that is not there: they are 1 to {size}")
    return corners, order


def _vertices(table: np.ndarray, files: Files) -> tuple[np.ndarray, np.ndarray | None]:
    """Positions (n, 3) and colours (n, 3) in 0..1, NaN of a vertex without one; None if no vertex has one. 4 numbers
    have a weight, by which the others are divided; 6 a colour, and 7 its opacity, which does not count."""
    weighted = np.isfinite(table[:, 3]) & np.isnan(table[:, 4])
    weight = np.where(weighted, table[:, 3], 1.0)[:, None]
    if (weight == 0).any():
        raise ValueError(f"vertex {np.argmin(weight != 0) + 1}: its fourth number, a weight, is 0")
    if (weight != 1).any():
        files.note("vertices", "their fourth number, a weight, is not 1: their positions are divided by it")
    vertices, colours = table[:, :3] / weight, np.where(weighted[:, None], np.nan, table[:, 3:6])
    if np.isnan(colours).all():
        return vertices, None
    return vertices, colours / (255 if np.nanmax(colours) >= 2 else 1)


def _definitions(path: Path, libraries: list[str], files: Files, coloured: bool) -> Definitions:
    """Where the library of each material is, by its name, and its statements. The first definition counts."""
    definitions: Definitions = {}
    for library in libraries:
        try:
            statements = named_files.mtl_statements(files.read(library))
        except FileNotFoundError as error:
            then = "drawn in the colours of its vertices" if coloured else DRAWN_GREY
            files.note(library, f"{str(error).removeprefix(f'{library}: ')}: {then}")
            continue
        material: dict[str, str] = {}
        place = named_files.find(path, library, files.root) or library
        for word, rest in statements:
            if word == "newmtl":
                material = {}
                definitions.setdefault(" ".join(rest.split()), (place, material))
            material[word] = rest
    return {without_comment(name): definition for name, definition in definitions.items()} | definitions


def _material(
    name: str, library: str, statements: dict[str, str], uv: np.ndarray | None, path: Path, files: Files
) -> tuple[PBRMaterial, np.ndarray | None, tuple[str, str] | None]:
    """The material of an MTL; texture coordinates (n, 2), as Blender's Mapping node has them; how a texture wraps."""

    def numbers(key: str, default: float) -> np.ndarray:
        try:
            values = np.array(without_comment(statements.get(key, "")).split() or default, dtype=float, ndmin=1)
            if np.isfinite(values).all():
                return np.clip(values, 0, 1000 if key == "ns" else 1)
        except ValueError:
            pass
        files.note(name, f"its {key.capitalize()}, {statements[key][:80]!r}, is not read: the default in its place")
        return np.array([default])

    options, texture = named_files.map_statement(statements.get("map_kd", ""))
    image = files.picture(named_files.beside(path, library, texture, files.root)) if texture else None
    if texture and image is None:
        return plain(GREY, name), uv, None
    image = image if uv is not None else None
    colour, roughness = numbers("kd", PLAIN), 1 - np.sqrt(numbers("ns", 0)[0] / 1000)
    material = PBRMaterial(
        name=name,
        baseColorTexture=image,
        baseColorFactor=[*np.resize(colour if image is None else 1.0, 3), 1.0],
        metallicFactor=numbers("pm", 0)[0],
        roughnessFactor=numbers("pr", roughness)[0],
    )
    if uv is not None:
        scale, offset = ([*map(float, options.get(key, [])), rest, rest][:2] for key, rest in (("-s", 1), ("-o", 0)))
        uv = uv * scale + offset
    return material, uv, ("clamp", "clamp") if options.get("-clamp") == ["on"] else None
