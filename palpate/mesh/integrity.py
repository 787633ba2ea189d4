"""Checks of a mesh file: before a library reads it, that its counts are possible; afterwards, that all was read."""

import re
import zipfile
from pathlib import Path

import numpy as np
import trimesh

from palpate.named_files import gltf_tree

MOST_UNPACKED, LARGEST_RATIO = 500e6, 100  # bytes of an unpacked 3MF file; these over its own, where 10 is common
ELEMENTS_A_BYTE = 100  # of the file, at most, of a glTF accessor without data of its own (zeros, or an extension's)
VERTEX_ZERO = re.compile(rb"^f[^\n]*[ \t]0(?=[/ \t\r\n])", re.MULTILINE)


def check_sizes(path: Path) -> None:
    """Raise ValueError if a file states more elements than it can hold; reads its headers only."""
    suffix = path.suffix.lower()
    if suffix in (".glb", ".gltf"):
        tree, _ = gltf_tree(path)
        views = [view["byteLength"] for view in tree.get("bufferViews", [])]
        for number, each in enumerate(tree.get("accessors", [])):
            most = views[each["bufferView"]] if "bufferView" in each else ELEMENTS_A_BYTE * path.stat().st_size
            if not 0 <= each["count"] <= most:
                raise ValueError(f"accessor {number} says {each['count']:,} elements, and has {most:,} bytes at most")
    if suffix == ".3mf":
        with zipfile.ZipFile(path) as archive:
            size = sum(each.file_size for each in archive.infolist())
        if size > max(MOST_UNPACKED, LARGEST_RATIO * path.stat().st_size):
            raise ValueError(f"its {path.stat().st_size / 1e6:.1f} MB are {size / 1e6:,.0f} MB unpacked")
    if suffix == ".obj" and VERTEX_ZERO.search(path.read_bytes()):
        raise ValueError("a face refers to vertex 0, and vertices of an OBJ are counted from 1")


def check_whole(path: Path, loaded: trimesh.Scene) -> None:
    """Raise ValueError if a PLY or an OFF has fewer elements than its header says; an OFF gets its colours."""
    for mesh in loaded.geometry.values():
        for name, element in mesh.metadata.get("_ply_raw", {}).items():
            _compare(name, element["length"], _rows(element.get("data", [])))
    if path.suffix.lower() == ".off":
        _take_off(path, next(iter(loaded.geometry.values())))


def _compare(name: str, stated: int, found: int) -> None:
    names = {"vertex": "vertices", "face": "faces"}
    if found < stated:
        raise ValueError(f"cut off: it says {stated:,} {names.get(name, name)}, and has {found:,}")


def _rows(data) -> int:
    """Number of complete rows of an element of a PLY, as trimesh has it."""
    columns = list(data.values()) if isinstance(data, dict) else [data]
    return min((sum(np.size(each) > 2 for each in c) if c.dtype == object else len(c) for c in columns), default=0)


def _take_off(path: Path, mesh: trimesh.Trimesh) -> None:
    """Compare an OFF's counts, and read its colours, which trimesh does not: of vertices, or of triangles."""
    lines = [words for line in path.read_text(errors="replace").splitlines() if (words := line.split("#")[0].split())]
    kind, counts, rows = (lines[0][0], lines[0][1:], lines[1:])
    if not counts:
        counts, rows = rows[0], rows[1:]
    vertices, faces = int(counts[0]), int(counts[1])
    rows, face_rows = rows[:vertices], rows[vertices : vertices + faces]
    _compare("face", faces, sum(len(row) > int(row[0]) for row in face_rows))
    if kind.startswith("C"):
        start = 6 if "N" in kind else 3
        colours, place = [row[start : start + 3] for row in rows], "vertex_colors"
    elif all(row[0] == "3" and len(row) in (7, 8) for row in face_rows):
        colours, place = [row[4:7] for row in face_rows], "face_colors"
    else:
        return
    scale = 255 if any("." in number for number in colours[0]) else 1  # numbers with a point are in 0..1
    setattr(mesh.visual, place, np.clip(np.round(scale * np.array(colours, dtype=float)), 0, 255).astype(np.uint8))
