"""PLY (Turk 1994), text or binary: polygons, triangle strips, colours, normals, and textures as MeshLab writes them."""

import re
import struct
from array import array
from pathlib import Path

import numpy as np

from palpate.mesh.files import Files
from palpate.mesh.formats.corners import distinct, numbers, usable_normals
from palpate.mesh.part import GREY, Loaded, linear, make_part, plain
from palpate.mesh.polygons import triangulate

HEADER = re.compile(rb"ply[ \t]*(?:\r(?!\n).*?\r[ \t]*end_header[ \t]*\r|.*?\n[ \t]*end_header[ \t]*\r?\n)", re.DOTALL)
TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
         "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
         "float32": "f4", "float64": "f8"}  # fmt: skip
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
NAMES = {"vertex": "vertices", "face": "faces"}
CHANNELS = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"))
COORDINATES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texture_s", "texture_t"))


def read(path: Path, files: Files) -> Loaded:
    """One part, or one for each texture. Raises ValueError if it has fewer elements than it says."""
    elements, textures = _elements(path.read_bytes())
    vertex, face, strips = (elements.get(name, {}) for name in ("vertex", "face", "tristrips"))
    vertices = _columns(vertex, ("x", "y", "z"))
    if vertices is None:
        raise ValueError("its vertices have no x, y and z")
    corners, counts = _indices(face or strips)
    if strips and not face:
        places, owner = _triangles_of_strips(corners, counts)
    else:
        places, owner = triangulate(vertices, corners, counts)
    triangles = corners[places]
    columns = {
        "vertices": vertices,
        "normals": usable_normals(_columns(vertex, ("nx", "ny", "nz"))),
        "uv": next((found for names in COORDINATES if (found := _columns(vertex, names)) is not None), None),
        "colours": _colours(vertex),
    }
    # What tells apart the corners at one vertex: texture coordinates of their own, or the colours of their faces.
    own, of_face = [triangles.ravel()], np.repeat(owner, 3)
    wedges, lengths = face.get("texcoord", (np.zeros(0), np.zeros(0)))
    wedged = len(wedges) and np.array_equal(lengths, 2 * counts)
    coloured = _colours(face) if columns["colours"] is None else None
    if wedged:
        wedges = wedges.reshape(-1, 2)[places.ravel()].astype(float)
        own.append(np.unique(wedges @ (1, 1j), return_inverse=True)[1])
    if coloured is not None:
        own.append(of_face)
    if len(own) > 1:
        first, number = distinct(*own)
        triangles = number.reshape(-1, 3)
        columns = {name: column if column is None else column[own[0][first]] for name, column in columns.items()}
        if wedged:
            columns["uv"] = wedges[first]
        if coloured is not None:
            columns["colours"] = coloured[of_face[first]]
    vertices = columns.pop("vertices")
    if textures and columns["uv"] is None:
        files.note(textures[0], "there are no texture coordinates for it: not drawn")
    if not textures or columns["uv"] is None:
        return Loaded([make_part("ply", vertices, triangles, **columns)])
    del columns["colours"]
    parts, chosen = [], face.get("texnumber", np.zeros(len(counts)))[owner]
    for number, name in enumerate(textures):
        image = files.picture(name)
        material = plain(GREY if image is None else 1.0, name)
        material.baseColorTexture = image
        parts.append(make_part(name, vertices, triangles[chosen == number], material, **columns))
    return Loaded(parts)


def _elements(data):
    """Values (n,) of each property, lists as (values of all rows, counts (n,)), by element and name; texture files."""
    header = HEADER.match(data)
    if header is None:
        raise ValueError("it has no header from `ply` to `end_header`")
    elements, order, textures = [], "", []
    for line in header[0].decode(errors="replace").splitlines():
        match line.split():
            case ["format", kind, *_]:
                order = ORDERS[kind]
            case ["comment", word, _, *_] if word.lower() == "texturefile":
                textures.append(line.split(None, 2)[2].strip())
            case ["element", name, count]:
                elements.append((name, int(count), []))
            case ["property", *lengths, kind, name]:
                elements[-1][2].append((name.lower(), np.dtype(TYPES[kind]), TYPES[lengths[1]] if lengths else None))
    body, at, held = data[header.end() :], 0, {}
    if not order:  # the numbers of a text are read as if they were binary ones of eight bytes
        body = numbers(_rows_alone(body, elements)).tobytes()
    for name, count, properties in elements:
        stored = [(order + k.str[1:], n and order + n) if order else ("f8", n and "f8") for _, k, n in properties]
        values, at = _rows(body, at, name, count, stored)
        held[name] = {}
        for (key, kind, length), value in zip(properties, values, strict=True):
            if not order and kind.kind != "f":  # that a float was written in text says nothing of its digits
                value = (value[0].astype(kind), value[1]) if length else value.astype(kind)
            held[name][key] = value
    return held, textures


def _rows_alone(body, elements):
    """A text without what some programs add to the rows of an element, if each row has a line."""
    lines, row = [line for line in body.splitlines() if line.strip()], 0

    def own(line, properties):
        words, end = line.split(), 0
        for *_, length in properties:
            end += 1 + int(words[end]) if length and end < len(words) else 1
        return words[:end], len(words) > end

    if len(lines) == sum(count for _, count, _ in elements):
        for _, count, properties in elements:
            if count and own(lines[row], properties)[1]:
                lines[row : row + count] = [b" ".join(own(line, properties)[0]) for line in lines[row : row + count]]
            row += count
    return b"\n".join(lines)


def _rows(data, at, name, count, stored):
    """Values of each property of an element's rows, and where the element ends; stored: types of values and counts."""
    kinds, heads = [np.dtype(kind) for kind, _ in stored], [n and np.dtype(n) for _, n in stored]
    unpack = [head and struct.Struct((">" if head.str[0] == ">" else "<") + head.char).unpack_from for head in heads]
    places = array("q")  # start and number of values of each property, row by row

    def take(at):
        for kind, head, number in zip(kinds, heads, unpack, strict=True):
            length = 1
            if head:
                length = int(number(data, at)[0])
                at += head.itemsize
            places.extend((at, length))
            at += length * kind.itemsize
        if at > len(data):
            del places[-2 * len(kinds) :]
            raise struct.error
        return at

    def strided(start, length, kind):
        return np.ndarray((count, length), kind, data, start, (stride, kind.itemsize)).ravel()

    try:
        end = take(at) if count else at
        stride, first = end - at, np.array(places, dtype=np.int64).reshape(-1, 2).tolist() or [(at, 0)] * len(kinds)
        if at + count * stride <= len(data) and all(
            (strided(start - head.itemsize, 1, head) == length).all()
            for (start, length), head in zip(first, heads, strict=True)
            if head and count
        ):  # all rows are as long as the first
            values = [strided(*place, kind) for place, kind in zip(first, kinds, strict=True)]
            counts, end = [np.full(count, length) for _, length in first], at + count * stride
        else:
            for _ in range(1, count):
                end = take(end)
            starts, counts = np.moveaxis(np.array(places, dtype=np.int64).reshape(count, len(kinds), 2), 0, 2).swapaxes(
                0, 1
            )
            values = []
            for kind, start, length in zip(kinds, starts, counts, strict=True):
                within = np.arange(length.sum()) - np.repeat(np.cumsum(length) - length, length)
                index = (np.repeat(start, length) + within * kind.itemsize)[:, None] + np.arange(kind.itemsize)
                values.append(np.frombuffer(data, np.uint8)[index].view(kind).ravel())
    except struct.error:
        held = len(places) // (2 * len(kinds))
        raise ValueError(f"cut off: it says {count:,} {NAMES.get(name, name)}, and has {held:,}") from None
    return [(value, number) if head else value for value, number, head in zip(values, counts, heads, strict=True)], end


def _columns(values, names):
    """The properties of these names side by side (n, k) as float64; None if one is missing."""
    return np.column_stack([values[name] for name in names]).astype(float) if set(names) <= set(values) else None


def _indices(values):
    """Vertex numbers of all polygons or strips, one after the other, and how many each has."""
    names = [name for name in ("vertex_indices", "vertex_index") if name in values]
    if values and not names:
        raise ValueError("its faces have no list `vertex_indices`")
    return values[names[0]] if names else (np.zeros(0, np.int64), np.zeros(0, np.int64))


def _triangles_of_strips(corners, counts):
    """Places (t, 3) in corners of the triangles of strips, separated by -1, and the strip (t,) of each."""
    corner, strip = corners.astype(np.int64), np.repeat(np.arange(len(counts)), counts)
    place = np.arange(len(corner))
    begin = np.r_[True, (strip[1:] != strip[:-1]) | (corner[:-1] == -1)] if len(corner) else np.zeros(0, bool)
    odd = (place - np.maximum.accumulate(np.where(begin, place, 0))) % 2
    index = place[:-2, None] + np.arange(3)
    a, b, c = corner[index].T
    good = (corner[index] >= 0).all(axis=1) & (strip[index[:, 0]] == strip[index[:, 2]])
    good &= (a != b) & (b != c) & (c != a)
    turned = np.where(odd[:-2, None] == 1, index[:, [1, 0, 2]], index)
    return turned[good], strip[:-2][good]


def _colours(values):
    """Colours (n, 4) uint8 in linear light; None if there are none. Floats are shares of 1 unless one is larger."""
    for names in CHANNELS:
        if set(names) <= set(values):
            alpha = names[0].replace("red", "alpha")
            channels = [values[name] for name in (*names, *((alpha,) if alpha in values else ()))]
            most = {"u2": 65535, "f4": 1, "f8": 1}.get(channels[0].dtype.str[1:], 255)
            share = np.column_stack(channels).astype(float)
            share = share / (most if share.max(initial=0) <= most else 255)
            return linear(np.round(255 * np.clip(share, 0, 1)).astype(np.uint8))
    return None
