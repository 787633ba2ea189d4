"""What a file is that is no mesh of `palpate.mesh.FORMATS`, by its suffix or its content, and what to do about it.

No engine is loaded.
"""

import re
from pathlib import Path

_CAD = "solids, not triangles: export it as STL or glTF from a CAD program, such as FreeCAD"
_SCENE = "not read: export it as glTF from Blender"
_OTHER = "not read: export it as glTF, OBJ or STL from the program that it comes from"
_VTK = "not read: export its surface as PLY from ParaView"
_WEB = "not read: export it as PLY from MeshLab"
_POINTS = "points without triangles: reconstruct a surface first"

# Formats of 3D data that are not read: name and remedy, by suffix.
UNREAD: dict[str, tuple[str, str]] = {
    suffix: (name, remedy)
    for suffixes, name, remedy in (
        (".step .stp .p21 .stpz", "STEP", _CAD), (".iges .igs", "IGES", _CAD), (".brep .brp", "BREP", _CAD),
        (".x_t .x_b .xmt_txt .xmt_bin", "Parasolid", _CAD), (".sat .sab", "ACIS", _CAD), (".jt", "JT", _CAD),
        (".sldprt .sldasm", "SolidWorks", _CAD), (".ipt .iam", "Inventor", _CAD), (".dwg .dxf", "AutoCAD", _CAD),
        (".catpart .catproduct", "CATIA", _CAD), (".prt .asm", "NX or Creo", _CAD), (".f3d", "Fusion", _CAD),
        (".fcstd", "FreeCAD", _CAD), (".3dm", "Rhino", _CAD), (".ifc", "IFC", _CAD), (".scad", "OpenSCAD", _CAD),
        (".usd .usda .usdc .usdz", "USD", _SCENE), (".fbx", "FBX", _SCENE), (".blend", "Blender", _SCENE),
        (".abc", "Alembic", _SCENE), (".3ds .max", "3ds Max", _OTHER), (".ma .mb", "Maya", _OTHER),
        (".c4d", "Cinema 4D", _OTHER), (".lwo .lws", "LightWave", _OTHER), (".skp", "SketchUp", _OTHER),
        (".amf", "AMF", _OTHER), (".msh", "MSH", _OTHER), (".vtk .vtp .vtu", "VTK", _VTK),
        (".wrl .wrz .vrml", "VRML", _WEB), (".x3d .x3dv", "X3D", _WEB),
        (".xyz .pcd .las .laz .e57 .pts", "point cloud", _POINTS),
    )
    for suffix in suffixes.split()
}  # fmt: skip

_XML = rb"(?:<\?xml[^>]*>\s*)?(?:<!--(?s:.*?)-->\s*)*"
_ARCHIVE = "an archive or a compressed file: unpack it"
# What a file is, by what it begins with: a suffix of `UNREAD`, one of a format that is read, or a sentence.
_BEGINNINGS = (
    (rb"version https://git-lfs", "a Git LFS pointer, not the file itself: run `git lfs pull` where it comes from"),
    (rb"ISO-10303-21", ".step"), (rb"(?s:.{72})S[ 0]{6}1\s", ".iges"), (rb"DBRep_Draw|CASCADE Topology", ".brep"),
    (rb"Kaydara FBX|; FBX", ".fbx"), (rb"#usda|PXR-USDC", ".usd"), (rb"BLENDER", ".blend"), (rb"#VRML", ".wrl"),
    (rb"#X3D|" + _XML + rb"<!DOCTYPE X3D|" + _XML + rb"<X3D", ".x3d"), (rb"# vtk DataFile|<VTKFile", ".vtk"),
    (rb"ply\r?\n", ".ply"), (rb"glTF", ".glb"), (rb"\{(?s:.{,2000})\"asset\"", ".gltf"), (rb"(?:ST)?C?N?OFF\s", ".off"),
    (rb"solid .*\s+facet ", ".stl"), (rb"(?:#.*\s+)*(?:mtllib |v +[-\d.])", ".obj"), (_XML + rb"<COLLADA", ".dae"),
    (_XML + rb"(?i:<(?:!doctype )?html)", "an HTML page: download the file itself"),
    (_XML + rb"<Error>|\{\s*\"(?:error|message)\"", "an error message of a server: download the file again"),
    (rb"%PDF|\x89PNG|\xff\xd8\xff|GIF8", "a document or a picture: remove it"),
    (rb"PK\x03\x04(?s:.{26,})(?:\[Content_Types\]\.xml|3D/)", ".3mf"), (rb"PK\x03\x04", _ARCHIVE),
    (rb"\x1f\x8b|BZh|7z\xbc\xaf|\xfd7zXZ|Rar!|\x28\xb5\x2f\xfd", _ARCHIVE),
    (rb"\x00+\Z|\Z", "empty, or nothing but zeros: copy or download it again"),
)  # fmt: skip


def what_it_is(path: Path | str) -> str:
    """What a file is by its content, and the remedy, if it is not what its suffix says; else empty."""
    suffix = Path(path).suffix.lower()
    with open(path, "rb") as file:
        head = file.read(4096).removeprefix(b"\xef\xbb\xbf")
    for pattern, meaning in _BEGINNINGS:
        if re.match(pattern, head) or re.match(pattern, head.lstrip()):
            if meaning == suffix or (suffix == ".3mf" and head[:2] == b"PK"):
                return ""
            if meaning in UNREAD:
                return "{} by its content: {}".format(*UNREAD[meaning])
            return f"{meaning[1:].upper()} by its content: rename it to {meaning}" if meaning[0] == "." else meaning
    return ""
