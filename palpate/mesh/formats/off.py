"""OFF, as Geomview documents it: text, with normals and colours of vertices, or colours of faces. A face's colour may
be three or four numbers. They are shares of 1 if one has a point or none is more than 1, else of 255. One number is an
entry of a table that is not in the file, and does not count. There is no texture to draw."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from palpate.mesh.part import PLAIN, Files, Loaded, linear, make_part, usable_normals
from palpate.mesh.polygons import triangulate

# `OFF` and the counts may stand in one word, as in ModelNet, and `OFF` may be missing.
KEYWORD = re.compile(r"^(?:(ST)?(C)?(N)?OFF(?=[\s\d]|$))?")


def read(path: Path, files: Files) -> Loaded:
    """One part. Raises ValueError if it is binary, of another dimension, or has fewer elements than it says."""
    text = re.sub(r"#[^\n]*", "", path.read_bytes().decode(errors="replace").replace("\r", "\n")).lstrip("\ufeff \t\n")
    _, textured, coloured, normal, body = KEYWORD.split(text, maxsplit=1)
    lines = [words for line in body.split("\n") if (words := line.split())]
    if not lines or not lines[0][0].isdigit():
        raise ValueError("binary OFF, and OFF of other than three dimensions, are not read: write it as text or as PLY")
    count, faces = int(lines[0][0]), int(lines[0][1])
    rows, polygons = lines[1 : 1 + count], lines[1 + count : 1 + count + faces]
    whole = sum(len(row) > int(row[0]) for row in polygons)
    for stated, held, name in ((count, len(rows), "vertices"), (faces, whole, "faces")):
        if held < stated:
            raise ValueError(f"cut off: it says {stated:,} {name}, and has {held:,}")
    start = 6 if normal else 3  # of a vertex's colour
    table = np.array([row[:start] for row in rows], dtype=float).reshape(-1, start)
    vertices, normals, colours = table[:, :3], usable_normals(table[:, 3:]), None
    counts = [int(row[0]) for row in polygons]
    corners = np.array([corner for row, n in zip(polygons, counts, strict=True) for corner in row[1 : n + 1]], np.int64)
    places, owner = triangulate(vertices, corners, counts)
    triangles = corners[places]
    of_faces = [row[n + 1 :] if len(row) - n in (4, 5) else [] for row, n in zip(polygons, counts, strict=True)]
    if coloured:
        colours = _colours([row[start : -2 if textured else None] for row in rows])
    elif any(of_faces):
        vertices = vertices[triangles.ravel()]
        normals = None if normals is None else normals[triangles.ravel()]
        triangles = np.arange(triangles.size).reshape(-1, 3)
        colours = np.repeat(_colours(of_faces)[owner], 3, axis=0)
    return Loaded([make_part("off", vertices, triangles, normals=normals, colours=colours)])


def _colours(rows: Sequence[Sequence[str]]) -> np.ndarray:
    """Linear light (n, 4) uint8 of rows of no, three or four numbers; those without have `PLAIN`."""
    has = np.array([len(row) >= 3 for row in rows])
    values = np.array([row[:3] for row in rows if len(row) >= 3], dtype=float).reshape(-1, 3)
    shares = any("." in number for row in rows for number in row) or values.max(initial=0) <= 1
    colours = np.full((len(rows), 4), [round(255 * PLAIN)] * 3 + [255], dtype=np.uint8)
    colours[has] = linear(np.clip(np.round(values * (255 if shares else 1)), 0, 255).astype(np.uint8))
    return colours
