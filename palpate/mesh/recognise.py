"""What a file is that is no mesh of `palpate.mesh.FORMATS`, by its suffix or its content, and what to do about it.

No engine is loaded.
"""

import re
from pathlib import Path

# Formats of 3D data that are not read: names and suffixes, by remedy.
_FORMATS = {
    "solids, not triangles: export it as STL or glTF from a CAD program, such as FreeCAD":
        "STEP: .step .stp .stpz .p21, IGES: .iges .igs, BREP: .brep .brp, Parasolid: .x_t .x_b .xmt_txt .xmt_bin, "
        "ACIS: .sat .sab, JT: .jt, SolidWorks: .sldprt .sldasm, Inventor: .ipt .iam, AutoCAD: .dwg .dxf, "
        "CATIA: .catpart .catproduct, NX or Creo: .prt .asm, Fusion: .f3d, FreeCAD: .fcstd, Rhino: .3dm, IFC: .ifc, "
        "OpenSCAD: .scad",
    "not read: export it as glTF, OBJ or STL from Blender, or from the program that it comes from":
        "USD: .usd .usda .usdc .usdz, FBX: .fbx, Blender: .blend, Alembic: .abc, 3ds Max: .3ds .max, Maya: .ma .mb, "
        "Cinema 4D: .c4d, LightWave: .lwo .lws, SketchUp: .skp, VRML: .wrl .wrz .vrml, X3D: .x3d .x3dv, "
        "VTK: .vtk .vtp .vtu, MSH: .msh, AMF: .amf",
    "points without triangles: reconstruct a surface first": "point cloud: .xyz .pcd .las .laz .e57 .pts",
}  # fmt: skip
# Name and remedy by suffix.
UNREAD: dict[str, tuple[str, str]] = {
    suffix: (name, remedy)
    for remedy, formats in _FORMATS.items()
    for name, suffixes in (entry.split(": ") for entry in formats.split(", "))
    for suffix in suffixes.split()
}

_XML = rb"(?:<\?xml[^>]*>\s*)?(?:<!--(?s:.*?)-->\s*)*"
# What a file is, by what it begins with: a suffix of `UNREAD`, one of a format that is read, or a sentence.
_BEGINNINGS = (
    (rb"version https://git-lfs", "a Git LFS pointer, not the file itself: run `git lfs pull` where it comes from"),
    (rb"ISO-10303-21", ".step"), (rb"(?s:.{72})S[ 0]{6}1\s", ".iges"), (rb"Kaydara FBX|; FBX", ".fbx"),
    (rb"#usda|PXR-USDC", ".usd"), (rb"BLENDER", ".blend"), (rb"#VRML", ".wrl"), (rb"ply\r?\n", ".ply"),
    (rb"glTF", ".glb"), (rb"\{(?s:.{,2000})\"asset\"", ".gltf"), (rb"(?:ST)?C?N?OFF\s", ".off"),
    (rb"solid .*\s+facet ", ".stl"), (rb"(?:#.*\s+)*(?:mtllib |v +[-\d.])", ".obj"), (_XML + rb"<COLLADA", ".dae"),
    (_XML + rb"(?i:<(?:!doctype )?html)", "an HTML page: download the file itself"),
    (_XML + rb"<Error>|\{\s*\"(?:error|message)\"", "an error message of a server: download the file again"),
    (rb"PK\x03\x04(?s:.{26,})(?:\[Content_Types\]\.xml|3D/)", ".3mf"),
    (rb"PK\x03\x04|\x1f\x8b|BZh|7z\xbc\xaf|Rar!", "an archive or a compressed file: unpack it"),
    (rb"\x00+\Z|\Z", "empty, or nothing but zeros: copy or download it again"),
)  # fmt: skip


def what_it_is(path: Path | str) -> str:
    """What a file is by its content, and the remedy, if it is not what its suffix says; else empty."""
    suffix = Path(path).suffix.lower()
    with open(path, "rb") as file:
        head = file.read(4096).removeprefix(b"\xef\xbb\xbf")
    meaning = next(
        (meaning for pattern, meaning in _BEGINNINGS if re.match(rb"\s*(?:" + pattern + rb")", head)), suffix
    )
    if meaning == suffix or (suffix == ".3mf" and head[:2] == b"PK"):
        return ""
    if meaning in UNREAD:
        return "{} by its content: {}".format(*UNREAD[meaning])
    return f"{meaning[1:].upper()} by its content: rename it to {meaning}" if meaning[0] == "." else meaning
