"""OFF, as Geomview documents it: text, with normals, colours, texture coordinates or a fourth coordinate of vertices.

A face's colour may be three or four numbers. They are shares of 1 if one has a point or none is more than 1, else of
255. One number is an entry of a table that is not in the file, and does not count.
"""

import re
from pathlib import Path

import numpy as np

from palpate.mesh.files import Files
from palpate.mesh.formats.corners import usable_normals
from palpate.mesh.part import PLAIN, Loaded, linear, make_part
from palpate.mesh.polygons import triangulate

# `OFF` and the counts may stand in one word, as in ModelNet.
KEYWORD = re.compile(r"(ST)?(C)?(N)?(4)?(n)?OFF(?=[\s\d]|$)")


def read(path: Path, files: Files) -> Loaded:
    """One part. Raises ValueError if it is binary, of another dimension, or has fewer elements than it says."""
    text = re.sub(r"#[^\n]*", "", path.read_bytes().decode(errors="replace").replace("\r", "\n")).lstrip("\ufeff \t\n")
    keyword = KEYWORD.match(text)
    textured, coloured, normal, homogeneous, dimensions = keyword.groups() if keyword else [None] * 5
    lines = [words for line in text[keyword.end() if keyword else 0 :].split("\n") if (words := line.split())]
    if dimensions or (lines and lines[0][0] == "BINARY"):
        raise ValueError("binary OFF, and OFF of other than three dimensions, are not read: write it as text or as PLY")
    count, faces = int(lines[0][0]), int(lines[0][1])
    rows, polygons = lines[1 : 1 + count], lines[1 + count : 1 + count + faces]
    held = sum(len(row) > int(row[0]) for row in polygons)
    for stated, number, name in ((count, len(rows), "vertices"), (faces, held, "faces")):
        if number < stated:
            raise ValueError(f"cut off: it says {stated:,} {name}, and has {number:,}")
    width = 4 if homogeneous else 3
    start = width + (3 if normal else 0)
    table = np.array([row[:start] for row in rows], dtype=float).reshape(-1, start)
    vertices = table[:, :3] / (table[:, 3:4] if homogeneous else 1)
    normals = usable_normals(table[:, width:start]) if normal else None
    uv = np.array([row[-2:] for row in rows], dtype=float) if textured else None
    counts = [int(row[0]) for row in polygons]
    corners = np.array([corner for row, n in zip(polygons, counts, strict=True) for corner in row[1 : n + 1]], np.int64)
    places, owner = triangulate(vertices, corners, counts)
    triangles = corners[places]
    own = [row[n + 1 :] if len(row) - n in (4, 5) else [] for row, n in zip(polygons, counts, strict=True)]
    colours = None
    if coloured:
        colours = _colours([row[start : -2 if textured else None] for row in rows])
    elif any(own):
        vertices, uv, normals = (None if each is None else each[triangles.ravel()] for each in (vertices, uv, normals))
        triangles = np.arange(triangles.size).reshape(-1, 3)
        colours = np.repeat(_colours(own)[owner], 3, axis=0)
    return Loaded([make_part("off", vertices, triangles, normals=normals, uv=uv, colours=colours)])


def _colours(rows):
    """Linear light (n, 4) uint8 of rows of no, three or four numbers; those without have `PLAIN`."""
    has = np.array([len(row) >= 3 for row in rows])
    values = np.array([row[:3] for row in rows if len(row) >= 3], dtype=float).reshape(-1, 3)
    shares = any("." in number for row in rows for number in row) or values.max(initial=0) <= 1
    colours = np.full((len(rows), 4), [round(255 * PLAIN)] * 3 + [255], dtype=np.uint8)
    colours[has] = linear(np.clip(np.round(values * (255 if shares else 1)), 0, 255).astype(np.uint8))
    return colours
