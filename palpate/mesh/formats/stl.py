"""STL, binary or text. Its normals and the colours that some programs put into it are not read.

Not by trimesh, which takes a binary file for text if bytes follow its triangles, and the words `vertex` and `solid` of
a name for those of the format.
"""

import re
from pathlib import Path

import numpy as np

from palpate.mesh.files import Files
from palpate.mesh.formats.corners import numbers
from palpate.mesh.part import Loaded, make_part

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
    if (count and held >= count) or not (FACET.search(text) or END.search(text)):
        if len(data) < 84 or held < count:
            raise ValueError(f"cut off: it says {count:,} faces, and has {held:,}")
        return Loaded([_part("solid", np.frombuffer(data, TRIANGLE, count, 84)["corners"])])
    *solids, rest = END.split(text)
    if FACET.search(rest):
        raise ValueError("cut off: its last solid has no `endsolid`")
    return Loaded([_part(f"solid {number}", _text(solid)) for number, solid in enumerate(solids)])


def _text(solid):
    corners, facets = VERTEX.findall(solid), len(FACET.findall(solid))
    values = numbers(b" ".join(corners))
    if len(corners) != 3 * facets or len(values) != 9 * facets:
        raise ValueError(f"it has {facets:,} facets and {len(values) / 3:,g} vertices, not three times as many")
    return values.reshape(-1, 3, 3)


def _part(name, triangles):
    return make_part(name, triangles.reshape(-1, 3).astype(float), np.arange(3 * len(triangles)).reshape(-1, 3))
