"""Wavefront OBJ with its material libraries (MTL), mostly as Blender takes them: one part a material.

`Kd` is linear light. Under a texture it does not count: many exporters leave a dark one there. `Pr` is the roughness,
else sqrt(Ns / 1000) less than 1; `Pm` is metallic. Colours of vertices are sRGB, and count where there is no material.
Points, lines and curves have no surface.
"""

import re
import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np
from trimesh.visual.material import PBRMaterial
from trimesh.visual.texture import unmerge_faces

from palpate import named_files
from palpate.mesh.files import GREY as IN_GREY
from palpate.mesh.files import Files
from palpate.mesh.part import GREY, PLAIN, Loaded, linear, make_part, plain
from palpate.mesh.polygons import triangulate
from palpate.named_files import text, without_comment

BLANK, OTHER, V, VT, VN, F = range(6)  # kinds of lines
KEYWORDS = {V: "v", VT: "vt", VN: "vn", F: "f"}
WIDTHS = {"v": (3, 4, 6, 7, 8), "vt": (1, 2, 3), "vn": (3,)}  # numbers in a line
NONE = np.iinfo(np.int64).min  # of a corner without a texture coordinate or a normal
# Statements that make no surface.
KNOWN = re.compile(
    "g|s|p|l|vp|mg|lod|curv2?|cstype|deg|bmat|step|parm|trim|hole|scrv|sp|end|con|cdc|cdp|res|bevel|[cd]_interp"
    "|[cs]tech|usemap|maplib|shadow_obj|trace_obj"
)
SURFACES = ("surf", "bsp", "bzp", "call", "csh")  # free-form ones, and what another file or program holds


class Lines(NamedTuple):
    """The lines of one kind: their numbers in the file, from 0, and their text without the keyword and comments."""

    keyword: str
    numbers: np.ndarray
    block: bytes

    def error(self, row: int, problem: str) -> ValueError:
        line = " ".join([self.keyword, *text(self.block.split(b"\n")[row]).split()])
        return ValueError(f"line {self.numbers[row] + 1}, {line[:80]!r}: {problem}")


def read(path: Path, files: Files) -> Loaded:
    """An OBJ's polygons as triangles, the parts sorted by name. Raises ValueError, which names the line."""
    content = path.read_bytes()
    kind, lines, others = _split(named_files.joined_lines(content))
    vertices, colours = _vertices(lines[V], others, files)
    uv = np.pad(_table(lines[VT])[0], ((0, 0), (0, 1)))[:, :2]
    uv[~np.isfinite(uv)] = 0  # where a line has u alone
    normals = _table(lines[VN])[0]
    corners, counts = _corners(lines[F])
    if len(counts) and lines[F].numbers[-1] == len(kind) - 1 and not content.endswith((b"\n", b"\r")):
        last = corners[len(corners) - counts[-1] :] == NONE
        if len(last) < 3 or (last != last[0]).any():
            raise lines[F].error(len(counts) - 1, "the file is cut off within this face")
    corners = _resolved(corners, counts, kind, lines[F], (len(vertices), len(uv), len(normals)), files)
    uses, objects, libraries = _statements(others, path, files, len(vertices) == 0)
    definitions = _definitions(path, libraries, files, colours is not None)
    uses = [(line, name if name in definitions else without_comment(name)) for line, name in uses]
    used, use = _in_force(uses, lines[F].numbers)
    object_names, within = _in_force(objects, lines[F].numbers)

    triangles, polygon = triangulate(vertices, corners[:, 0], counts)
    refs = corners[triangles]  # (t, 3 corners, 3): vertex, texture coordinate, normal
    given = (refs >= 0).all(axis=1)
    key = 4 * use[polygon] + given[:, 1:] @ (2, 1)
    several, parts = len(np.unique(key // 4)) > 1, {}
    for number in np.unique(key):
        mine = np.flatnonzero(key == number)
        columns = np.flatnonzero(given[mine[0]])
        faces, rows = _split_vertices(refs[mine][:, :, columns])
        row = dict(zip(columns, rows, strict=True))
        name = used[number // 4]
        material, scale, offset, wrap = None, 1.0, 0.0, None
        if name in definitions:
            material, scale, offset, wrap = _material(name, *definitions[name], 1 in row, path, files)
        elif name and libraries and colours is None:
            material = plain(GREY, name)
            if not files.problems.keys() & set(libraries):
                files.note(name, f"no material library has it: {IN_GREY}")
        name = (several and name) or object_names[within[polygon[mine[0]]]] or path.name
        name = next(each for k in range(len(parts) + 1) if (each := f"{name}_{k}" if k else name) not in parts)
        parts[name] = make_part(
            name,
            vertices[row[0]],
            faces,
            material,
            normals=normals[row[2]] if 2 in row else None,
            uv=uv[row[1]] * scale + offset if 1 in row else None,
            colours=_light(colours[row[0]]) if material is None and colours is not None else None,
            wrap=wrap,
        )
    return Loaded([parts[name] for name in sorted(parts)])


def _split(data: bytes) -> tuple[np.ndarray, dict[int, Lines], list[tuple[int, str]]]:
    """The kind of each line (n,), the lines of numbers by kind, and the others with their numbers."""
    data = re.sub(rb"\n[ \t]+", b"\n", b"\n" + data)[1:]
    letters = np.frombuffer(data + b"  ", np.uint8).copy()
    ends = np.flatnonzero(letters == 10)
    starts = np.append(0, ends[:-1] + 1)
    first, second, third = (letters[starts + k] for k in range(3))
    v, f = (first | 32 == ord(letter) for letter in "vf")  # small or capital
    alone, pair = second <= 32, third <= 32
    kind = np.where((first == 10) | ((first == ord("#")) & (second != ord("M"))), BLANK, OTHER).astype(np.uint8)
    kind[v & alone] = V
    kind[v & pair & (second | 32 == ord("t"))] = VT
    kind[v & pair & (second | 32 == ord("n"))] = VN
    kind[f & (alone | (pair & (second | 32 == ord("o"))))] = F  # fo: of old files
    letters[starts[kind >= V]] = 32
    letters[starts[(kind >= V) & ~alone] + 1] = 32
    of, letters = np.repeat(kind, np.diff(ends, prepend=-1)), letters[:-2]
    lines = {}
    for each, keyword in KEYWORDS.items():
        block = letters[of == each].tobytes()
        block = re.sub(rb"#[^\n]*", b"", block) if b"#" in block else block
        lines[each] = Lines(keyword, np.flatnonzero(kind == each), block)
    others = [(number, text(data[starts[number] : ends[number]])) for number in np.flatnonzero(kind == OTHER).tolist()]
    return kind, lines, others


def _words(block: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Where the words of a text begin, and how many each of its lines has."""
    letters = np.frombuffer(block, np.uint8)
    start = letters > 32
    start[1:] &= letters[:-1] <= 32
    place = np.flatnonzero(start)
    return place, np.diff(np.searchsorted(place, np.flatnonzero(letters == 10)), prepend=0)


def _parse(block: bytes, count: int, dtype: type) -> np.ndarray | None:
    """The numbers of a text of `count` words; None if a word is no number."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # NumPy's, where it stops reading
        try:
            values = np.fromstring(block, dtype, sep=" ") if count else np.zeros(0, dtype)
        except DeprecationWarning:
            return None
    return values if len(values) == count else None


def _bad_word(lines: Lines, dtype: type) -> ValueError:
    """The error of the first word that is no number, or no corner of a face."""
    for row, line in enumerate(lines.block.split(b"\n")):
        for word in line.split():
            numbers = word.replace(b"/", b" ") if dtype is np.int64 else word
            if word.startswith(b"/") or word.count(b"/") > 2 or _parse(numbers, len(numbers.split()), dtype) is None:
                return lines.error(row, f"{text(word)[:80]!r} is no {'number' if dtype is float else 'corner'}")
    return ValueError("its numbers can't be told apart")


def _table(lines: Lines) -> tuple[np.ndarray, np.ndarray]:
    """The numbers of lines (n, most), NaN where a line has fewer, and how many each has (n,)."""
    place, counts = _words(lines.block)
    values, widths = _parse(lines.block, len(place), float), WIDTHS[lines.keyword]
    if values is None:
        raise _bad_word(lines, float)
    if len(wrong := np.flatnonzero(~np.isin(counts, widths))):
        raise lines.error(wrong[0], f"it has {counts[wrong[0]]} numbers, not {' or '.join(map(str, widths))}")
    table = np.full((len(counts), counts.max(initial=widths[0])), np.nan)
    table[np.arange(table.shape[1]) < counts[:, None]] = values
    return table, counts


def _vertices(lines: Lines, others: list[tuple[int, str]], files: Files) -> tuple[np.ndarray, np.ndarray | None]:
    """Positions (n, 3) and colours (n, 3) in 0..1, NaN of a vertex without one; None if no vertex has one.

    4 numbers have a weight w, by which the others are divided; 6 a colour; 8 both; 7 a colour and its opacity, or w.
    """
    table, counts = _table(lines)
    if table.shape[1] == 3:  # or ZBrush's comments, eight digits a vertex
        digits = "".join(line[5:].strip() for _, line in others if line.startswith("#MRGB"))
        if len(table) == 0 or not re.fullmatch(f"[0-9a-fA-F]{{{8 * len(table)}}}", digits):
            return table, None
        return table, np.frombuffer(bytes.fromhex(digits), np.uint8).reshape(-1, 4)[:, 1:] / 255
    seven = table[counts == 7]
    opacity = np.isin(seven[:, 6:7], (1, 255)).all() or not (seven[:, 3] == 1).all()
    weighted = np.isin(counts, (4, 8) if opacity else (4, 7, 8))[:, None]
    weight = np.where(weighted, table[:, 3:4], 1.0)
    if (weight == 0).any():
        raise lines.error(np.flatnonzero(weight == 0)[0], "its fourth number, a weight, is 0")
    if (weight != 1).any():
        files.note("vertices", "their fourth number, a weight, is not 1: their positions are divided by it")
    colours = np.pad(table, ((0, 0), (0, 4)), constant_values=np.nan)
    colours = np.where(weighted, colours[:, 4:7], colours[:, 3:6])
    colours = None if np.isnan(colours).all() else colours / (255 if np.nanmax(colours) >= 2 else 1)
    return table[:, :3] / weight, colours


def _light(colours: np.ndarray) -> np.ndarray | None:
    """Colours (n, 3) as `make_part` takes them: `PLAIN` of single vertices without one, None if none has one."""
    missing = np.isnan(colours).any(axis=1)
    light = linear(np.round(255 * np.clip(np.nan_to_num(colours), 0, 1)).astype(np.uint8))
    light[missing, :3] = round(255 * PLAIN)
    return None if missing.all() else light


def _corners(lines: Lines) -> tuple[np.ndarray, np.ndarray]:
    """The numbers of all faces' corners as they stand (n, 3), of vertex, texture coordinate and normal, or `NONE`; and
    how many corners each face has."""
    corner, counts = _words(lines.block)
    block = lines.block.replace(b"/", b" ")
    number, _ = _words(block)
    values = _parse(block, len(number), np.int64)
    letters = np.frombuffer(b"  " + lines.block, np.uint8)
    after = letters[number + 1] == ord("/")  # the letter before the number is one
    column = after.astype(np.int8)
    column[after & (letters[number] == ord("/"))] = 2  # 1//2
    column[1:] += (column[1:] == 1) * column[:-1]
    many = (column > 2).any() or (np.minimum(column[1:], column[:-1]) == 2).any() or b"///" in lines.block
    if values is None or many or (column == 0).sum() != len(corner):
        raise _bad_word(lines, np.int64)
    corners = np.full((len(corner), 3), NONE)
    corners[np.cumsum(column == 0) - 1, column] = values
    return corners, counts


def _resolved(corners, counts, kind, lines: Lines, sizes: tuple[int, int, int], files: Files) -> np.ndarray:
    """Corners (n, 3) counted from 0, -1 for `NONE`. Negative numbers count back from the face's own line."""
    face = np.repeat(np.arange(len(counts)), counts)
    resolved = np.full_like(corners, -1)
    for column, name in enumerate(("vertex", "texture coordinate", "normal")):
        value, size, given = corners[:, column], sizes[column], corners[:, column] != NONE
        if column and not size:
            if given.any():
                files.note(f"{name}s", "faces name some, and the file has none: left out")
            continue
        before = size
        if (value[given] < 0).any():
            before = np.cumsum(kind == V + column)[lines.numbers][face]
        index = np.where(value < 0, before + value, value - 1)
        if len(wrong := np.flatnonzero(given & ((value == 0) | (index < 0) | (index >= size)))):
            at = wrong[0]
            there = np.broadcast_to(before, len(value))[at] if value[at] < 0 else size
            why = f"there are {there}" if value[at] else "they are counted from 1"
            raise lines.error(face[at], f"it has {name} {value[at]}, and {why}")
        resolved[given, column] = index[given]
    return resolved


def _statements(others: list[tuple[int, str]], path: Path, files: Files, empty: bool):
    """Of the lines without numbers: (line, material) of each `usemtl`, (line, name) of each `o`, and the libraries."""
    uses, objects, libraries, unknown = [], [], {}, []
    for number, line in others:
        word, rest = (line.split(None, 1) + ["", ""])[:2]
        match word.lower():
            case "usemtl":
                uses.append((number, " ".join(rest.split())))
            case "o":
                objects.append((number, rest.strip()))
            case "mtllib":
                libraries[rest] = None
            case keyword if keyword in SURFACES:
                files.note(keyword, "free-form surfaces and what other files hold are not read: left out")
            case keyword if keyword and keyword[0] != "#" and not KNOWN.fullmatch(keyword):
                unknown.append(f"line {number + 1}, {line[:80]!r}")
                if empty or not re.fullmatch("[a-z_]+2?", keyword):
                    raise ValueError(f"{unknown[-1]}, is no statement of an OBJ")
    if unknown:
        files.note("statements", f"{len(unknown)} that are not known, the first in {unknown[0]}: left out")
    names = (name for rest in libraries for name in named_files.library_names(path, rest, files.root))
    return uses, objects, list(dict.fromkeys(names))


def _in_force(marks: list[tuple[int, str]], lines: np.ndarray) -> tuple[list[str], np.ndarray]:
    """The different values of statements (line, value), "" first, and which of them is in force at each line."""
    values = {"": 0}
    index = [0, *(values.setdefault(value, len(values)) for _, value in marks)]
    return list(values), np.array(index)[np.searchsorted([line for line, _ in marks], lines)]


def _split_vertices(refs: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
    """Triangles (t, 3) whose corners differ wherever a column of `refs` (t, 3, c) does, and the columns of each."""
    if refs.shape[2] == 1:
        rows, faces = np.unique(refs[:, :, 0], return_inverse=True)
        return faces.reshape(-1, 3), [rows]
    faces, *rows = unmerge_faces(*np.moveaxis(refs, 2, 0))
    return faces, rows


def _definitions(path: Path, libraries: list[str], files: Files, coloured: bool) -> dict[str, tuple[str, dict]]:
    """Where the library of each material is, by its name, and its statements. The first definition counts."""
    definitions: dict[str, tuple[str, dict[str, str]]] = {}
    for library in libraries:
        try:
            statements = named_files.mtl_statements(files.read(library))
        except FileNotFoundError as error:
            then = "drawn in the colours of its vertices" if coloured else IN_GREY
            files.note(library, f"{str(error).removeprefix(f'{library}: ')}: {then}")
            continue
        material, place = {}, named_files.find(path, library, files.root)
        for word, rest in statements:
            if word == "newmtl":
                material = {}
                definitions.setdefault(" ".join(rest.split()), (place, material))
            material[word] = rest
    return {without_comment(name): each for name, each in definitions.items()} | definitions


def _material(name: str, library: str, statements: dict[str, str], has_uv: bool, path: Path, files: Files):
    """The material of an MTL; and the scale, the offset and the wrapping of its texture, as Blender's Mapping node."""
    given = {}
    for key in ("kd", "ns", "pm", "pr"):
        try:
            values = np.array(without_comment(statements.get(key, "")).split(), dtype=float)
        except ValueError:
            values = np.array([np.nan])
        if np.isfinite(values).all():
            given |= {key: values} if len(values) else {}
        else:
            files.note(name, f"its {key.capitalize()}, {statements[key][:80]!r}, is not read: the default in its place")
    options, texture = named_files.map_statement(statements.get("map_kd", ""))
    image = files.picture(named_files.beside(path, library, texture, files.root)) if texture else None
    if texture and image is None:
        return plain(GREY, name), 1.0, 0.0, None
    image = image if has_uv else None
    shininess = np.clip(given.get("ns", [0.0])[0], 0, 1000)
    colour = given.get("kd", [PLAIN]) if image is None else [1.0]
    material = PBRMaterial(
        name=name,
        baseColorTexture=image,
        baseColorFactor=[*np.clip(np.resize(colour, 3), 0, 1), 1.0],
        metallicFactor=np.clip(given.get("pm", [0.0])[0], 0, 1),
        roughnessFactor=np.clip(given.get("pr", [1 - np.sqrt(shininess / 1000)])[0], 0, 1),
    )
    scale, offset = ([*map(float, options.get(key, [])), rest, rest][:2] for key, rest in (("-s", 1.0), ("-o", 0.0)))
    return material, np.array(scale), np.array(offset), ("clamp", "clamp") if options.get("-clamp") == ["on"] else None
