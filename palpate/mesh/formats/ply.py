"""PLY (Turk 1994), text or binary: polygons, triangle strips, colours, normals, and textures as MeshLab writes them."""

import re
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from palpate.mesh.part import Files, Loaded, distinct, eight_bit, linear, make_part, numbers, textured, usable_normals
from palpate.mesh.polygons import strip_triangles, triangulate

HEADER = re.compile(rb"ply[ \t]*(?:\r(?!\n).*?\r[ \t]*end_header[ \t]*\r|.*?\n[ \t]*end_header[ \t]*\r?\n)", re.DOTALL)
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
# Codes of NumPy and `struct`, by PLY's names of types.
NAMES = "char uchar short ushort int uint float double int8 uint8 int16 uint16 int32 uint32 float32 float64"
TYPES = dict(zip(NAMES.split(), 2 * "bBhHiIfd", strict=True))
CHANNELS = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"))
COORDINATES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texture_s", "texture_t"))

Properties = dict[str, Any]  # of an element: values (n,) by name, of a list (values of all rows, lengths (n,))


def read(path: Path, files: Files) -> Loaded:
    """One part, or one for each texture. Raises ValueError if it has fewer elements than it says."""
    elements, textures = _elements(path.read_bytes())
    vertex, face, strips = (elements.get(name, {}) for name in ("vertex", "face", "tristrips"))
    vertices = _columns(vertex, ("x", "y", "z"))
    if vertices is None:
        raise ValueError("its vertices have no x, y and z")
    polygons = face or strips
    indices = [values for name, values in polygons.items() if name in ("vertex_indices", "vertex_index")]
    if polygons and not indices:
        raise ValueError("its faces have no list `vertex_indices`")
    corners, counts = indices[0] if indices else np.zeros((2, 0), np.int64)
    places, owner = strip_triangles(corners, counts) if strips and not face else triangulate(vertices, corners, counts)
    triangles = corners[places]
    columns: dict[str, Any] = {
        "vertices": vertices,
        "normals": usable_normals(_columns(vertex, ("nx", "ny", "nz"))),
        "uv": next((uv for names in COORDINATES if (uv := _columns(vertex, names)) is not None), None),
        "colours": _colours(vertex),
    }
    # Corners at one vertex differ if texture coordinates are theirs, or colours are of faces.
    corner, of_face = triangles.ravel(), np.repeat(owner, 3)
    keys, of_corners = [corner], {}
    wedges, lengths = face.get("texcoord", (corner, None))
    if len(wedges) and np.array_equal(lengths, 2 * counts):
        of_corners["uv"] = wedges.reshape(-1, 2)[places.ravel()].astype(float)
        keys.append(np.unique(of_corners["uv"] @ (1, 1j), return_inverse=True)[1])
    if columns["colours"] is None and (colours := _colours(face)) is not None:
        of_corners["colours"] = colours[of_face]
        keys.append(of_face)
    if of_corners:
        first, number = distinct(*keys)
        triangles = number.reshape(-1, 3)
        columns = {name: column if column is None else column[corner[first]] for name, column in columns.items()}
        columns |= {name: column[first] for name, column in of_corners.items()}
    if textures and columns["uv"] is None:
        files.note(textures[0], "there are no texture coordinates for it: not drawn")
    if not textures or columns["uv"] is None:
        return Loaded([make_part("ply", faces=triangles, **columns)])
    del columns["colours"]
    parts, chosen = [], face.get("texnumber", np.zeros(len(counts)))[owner]
    for place, name in enumerate(textures):
        material = textured(files.picture(name), name)
        parts.append(make_part(name, faces=triangles[chosen == place], material=material, **columns))
    return Loaded(parts)


def _elements(data: bytes) -> tuple[dict[str, Properties], list[str]]:
    """The properties of each element by its name, and the names of textures."""
    header = HEADER.match(data)
    if header is None:
        raise ValueError("it has no header from `ply` to `end_header`")
    order, textures = "", []
    elements: list[tuple[str, int, list[tuple[str, str, str]]]] = []
    held: dict[str, Properties] = {}
    for line in header[0].decode(errors="replace").splitlines():
        match line.split():
            case ["format", kind, *_]:
                order = ORDERS[kind]
            case ["comment", word, _, *_] if word.lower() == "texturefile":
                textures.append(line.split(None, 2)[2].strip())
            case ["element", name, rows]:
                elements.append((name, int(rows), []))
            case ["property", *length, kind, name]:
                elements[-1][2].append((name.lower(), TYPES[kind], TYPES[length[1]] if length else ""))
    data, at = data[header.end() :], 0
    lines: list[bytes] = []
    if not order:  # the numbers of a text are read as if they were binary ones of eight bytes
        lines = [line for line in data.splitlines() if line.strip()]
        data = numbers(data).tobytes()
    one_a_line = len(lines) == sum(count for _, count, _ in elements)
    for name, count, properties in elements:
        width = 8 * len(lines[0].split()) if one_a_line and count else 0
        lines = lines[count:]
        stored = [(order + code, length and order + length) for _, code, length in properties]
        stored = stored if order else [("d", length and "d") for _, _, length in properties]
        columns, at = _rows(data, at, name, count, stored, width)
        held[name] = {}
        for (key, code, is_list), (values, lengths) in zip(properties, columns, strict=True):
            values = values if code in "fd" else values.astype(code)  # a float of a text keeps all its digits
            held[name][key] = (values, lengths) if is_list else values
    if not order and at < len(data):
        raise ValueError(f"it has {(len(data) - at) // 8:,} numbers more than its header says")
    return held, textures


def _rows(
    data: bytes, at: int, name: str, count: int, codes: list[tuple[str, str]], width: int
) -> tuple[list[tuple[np.ndarray, np.ndarray]], int]:
    """(Values (n,), lengths (count,)) of each property of an element's rows, which begin `at`, and where they end.
    codes: of a value and, of a list, of its length; width: bytes of the first row's line, of which MeshLab writes more
    than its header says. Raises ValueError if the data end before."""
    fields: list[tuple[Any, ...]] = []
    columns: list[list[np.ndarray]] = [[] for _ in codes]
    try:
        for number, (code, length_code) in enumerate(codes):  # of the first row
            length = 1
            if length_code:
                length = int(struct.unpack_from(length_code, data, at + np.dtype(fields).itemsize)[0]) if count else 0
                fields.append((f"length {number}", length_code))
            fields.append((f"{number}", code, (length,)))
        row = np.dtype([*fields, ("more", f"V{max(0, width - np.dtype(fields).itemsize)}")])
        if at + count * row.itemsize <= len(data):
            table = np.frombuffer(data, row, count, at)
            if all((table[key] == table[key][:1]).all() for key, *_ in fields if "length" in key):
                values = [table[f"{number}"] for number in range(len(codes))]
                return [(value.ravel(), np.full(count, value.shape[1])) for value in values], at + table.nbytes
        for _ in range(count):
            for (code, length_code), column in zip(codes, columns, strict=True):
                length = int(struct.unpack_from(length_code, data, at)[0]) if length_code else 1
                at += struct.calcsize(length_code)
                column.append(np.array(struct.unpack_from(f"{code[:-1]}{length}{code[-1]}", data, at), code))
                at += column[-1].nbytes
    except struct.error:
        plural = {"vertex": "vertices"}.get(name, f"{name}s")
        raise ValueError(f"cut off: it says {count:,} {plural}, and has {len(columns[-1]):,}") from None
    return [(np.concatenate(column), np.array([len(values) for values in column])) for column in columns], at


def _columns(values: Properties, names: Sequence[str]) -> np.ndarray | None:
    """The properties of these names side by side (n, k) as float64; None if one is missing."""
    return np.column_stack([values[name] for name in names]).astype(float) if set(names) <= set(values) else None


def _colours(values: Properties) -> np.ndarray | None:
    """Colours (n, 4) uint8 in linear light; None if there are none. Floats are shares of 1 unless one is larger."""
    for names in CHANNELS:
        if set(names) <= set(values):
            alpha = names[0].replace("red", "alpha")
            channels = [values[name] for name in (*names, *((alpha,) if alpha in values else ()))]
            most = {"H": 65535, "f": 1, "d": 1}.get(channels[0].dtype.char, 255)
            share = np.column_stack(channels).astype(float)
            return linear(eight_bit(share / (most if share.max(initial=0) <= most else 255)))
    return None
