"""STL, binary or text. Its normals and the colours that some programs put into it are not read. Not by trimesh, which
takes a binary file for text if bytes follow its triangles, and the words `vertex` and `solid` of a name for those of
the format."""

import re
from pathlib import Path

import numpy as np

from palpate.mesh.part import Files, Loaded, make_part, numbers

TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
VERTEX = re.compile(rb"^[ \t]*vertex\b([^\n]*)", re.IGNORECASE | re.MULTILINE)
FACET = re.compile(rb"^[ \t]*facet\b", re.IGNORECASE | re.MULTILINE)
END = re.compile(rb"^[ \t]*endsolid\b[^\n]*", re.IGNORECASE | re.MULTILINE)


def read(path: Path, files: Files) -> Loaded:
    """One part for each solid. Raises ValueError if there are fewer triangles than the file says."""
    data = path.read_bytes()
    # A text's bytes 80 to 84 are a number that is larger than any file.
    count, held = int.from_bytes(data[80:84], "little"), max(len(data) - 84, 0) // TRIANGLE.itemsize
    text = data.replace(b"\r", b"\n") if data[:1024].lstrip()[:5].lower() == b"solid" else b""
    *solids, rest = END.split(text)
    if (count and held >= count) or not (solids or FACET.search(rest)):
        if len(data) < 84 or held < count:
            raise ValueError(f"cut off: it says {count:,} faces, and has {held:,}")
        parts = [np.frombuffer(data, TRIANGLE, count, 84)["corners"].astype(float)]
    else:
        if FACET.search(rest):
            raise ValueError("cut off: its last solid has no `endsolid`")
        parts = [numbers(b" ".join(VERTEX.findall(solid))) for solid in solids]
        if [len(part) for part in parts] != [9 * len(FACET.findall(solid)) for solid in solids]:
            raise ValueError("cut off: it has a facet that has not three vertices")
    faces = [np.arange(part.size // 3).reshape(-1, 3) for part in parts]
    return Loaded([make_part(f"solid {k}", part.reshape(-1, 3), faces[k]) for k, part in enumerate(parts)])
