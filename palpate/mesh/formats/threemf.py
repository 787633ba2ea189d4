"""3MF: the objects that its build shows, of the core specification with the production extension.

Colours are those of base materials and colour groups, in sRGB. Textures and supports are left out.
"""

import zipfile
from pathlib import Path

import numpy as np
from lxml import etree

from palpate.mesh.files import Files
from palpate.mesh.formats.corners import distinct, numbers
from palpate.mesh.part import Loaded, linear, make_part

MOST_UNPACKED, LARGEST_RATIO = 500e6, 100  # bytes of an unpacked file; these over its own, where 10 is common
UNITS = {"micron": 1e-6, "millimeter": 1e-3, "centimeter": 0.01, "inch": 0.0254, "foot": 0.3048, "meter": 1.0}
MODEL = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
# Extensions without which, or with what is read of them, the shape is the same (the last part of their names).
KNOWN = ("production/2015/06", "material/2015/02", "trianglesets/2021/07")
BARE = (231, 231, 231, 255)  # `palpate.mesh.part.PLAIN` in sRGB, of a triangle without a colour beside others


def read(path: Path, files: Files) -> Loaded:
    """One part for each object as it is built. Raises ValueError if it requires an extension that is not read."""
    with zipfile.ZipFile(path) as archive:
        size = sum(each.file_size for each in archive.infolist())
        if size > max(MOST_UNPACKED, LARGEST_RATIO * path.stat().st_size):
            raise ValueError(f"its {path.stat().st_size / 1e6:.1f} MB are {size / 1e6:,.0f} MB unpacked")
        models, names = {}, {name.lower(): name for name in archive.namelist()}

        def model(name):
            """The resources of a model file, by their ids, and its root."""
            name = names.get(name.lstrip("/").lower(), name)
            if name not in models:
                root = _parse(archive.read(name))
                spaces = [root.nsmap.get(prefix, prefix) for prefix in root.get("requiredextensions", "").split()]
                if missing := [space for space in spaces if not space.endswith(KNOWN)]:
                    raise ValueError(f"it requires an extension that is not read: {', '.join(missing)}")
                models[name] = {resource.get("id"): resource for resource in root.iterfind("{*}resources/*")}, root
            return models[name]

        relations = _parse(archive.read("_rels/.rels")) if "_rels/.rels" in names else ()
        start = next((one.get("Target") for one in relations if one.get("Type") == MODEL), "3D/3dmodel.model")
        _, root = model(start)
        parts = []

        def show(reference, name, frame, within):
            """Note the parts that a build item or a component of a model file shows."""
            path = (value for key, value in reference.attrib.items() if key.endswith("}path"))
            name, number = next(path, name), reference.get("objectid")
            resources, _ = model(name)
            shape = resources.get(number)
            if shape is None or _kind(shape) != "object" or shape in within:
                raise ValueError(f"object {number} of {name} is missing, or is within itself")
            if shape.get("type") in ("support", "solidsupport"):
                return
            frame = _frame(reference) @ frame
            if shape.find("{*}mesh") is not None:
                parts.append(_part(shape, resources, frame, files))
            for component in shape.iterfind("{*}components/{*}component"):
                show(component, name, frame, (*within, shape))

        for item in root.iterfind("{*}build/{*}item"):
            show(item, start, np.eye(4), ())
    return Loaded(parts, UNITS[root.get("unit", "millimeter")])


def _parse(data):
    return etree.fromstring(data, etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=True))


def _kind(element):
    return etree.QName(element).localname


def _frame(element):
    """The matrix (4, 4) of a component or a build item, for rows of coordinates."""
    rows = np.array((element.get("transform") or "1 0 0 0 1 0 0 0 1 0 0 0").split(), dtype=float)
    return np.c_[rows.reshape(4, 3), [0, 0, 0, 1]]


def _part(shape, resources, frame, files):
    """An object's triangles, in its build's frame."""
    triangles = list(shape.iterfind("{*}mesh/{*}triangles/{*}triangle"))
    corners = shape.iterfind("{*}mesh/{*}vertices/{*}vertex")
    vertices = numbers(" ".join([corner.get(axis) for corner in corners for axis in "xyz"]).encode()).reshape(-1, 3)
    faces = np.array([int(face.get(key)) for face in triangles for key in ("v1", "v2", "v3")], np.int64).reshape(-1, 3)
    vertices = vertices @ frame[:3, :3] + frame[3, :3]
    name, colours = shape.get("name") or f"object {shape.get('id')}", _colours(shape, triangles, resources, files)
    if colours is not None:
        first, number = distinct(faces.ravel(), np.unique(colours.view(np.uint32).ravel(), return_inverse=True)[1])
        vertices, colours, faces = vertices[faces.ravel()[first]], linear(colours[first]), number.reshape(-1, 3)
    return make_part(name, vertices, faces[:, ::-1] if np.linalg.det(frame) < 0 else faces, colours=colours)


def _colours(shape, triangles, resources, files):
    """Colours (3 t, 4) uint8 in sRGB of the corners of an object's triangles; None if it has none."""
    if not shape.get("pid") and not any(triangle.get("pid") for triangle in triangles):
        return None
    palettes = {None: []}
    colours = np.full((len(triangles), 3, 4), BARE, dtype=np.uint8)
    for row, triangle in enumerate(triangles):
        of = triangle if triangle.get("p1") else shape
        group, corner = triangle.get("pid") or shape.get("pid"), of.get("p1") or of.get("pindex")
        if group not in palettes:
            palettes[group] = _palette(resources.get(group), group, files)
        if palettes[group] and corner:
            colours[row] = [palettes[group][int(of.get(key) or corner)] for key in ("p1", "p2", "p3")]
    return colours.reshape(-1, 4) if any(palettes.values()) else None


def _palette(group, number, files):
    """RGBA of each material or colour of a group; none, and a note, of a group of another kind."""
    kind = "property" if group is None else _kind(group)
    if kind not in ("basematerials", "colorgroup"):
        files.note(f"{kind} {number}", "is not read: drawn in a plain grey")
        return []
    codes = [(colour.get("displaycolor") or colour.get("color") or "#CCCCCC").lstrip("#") for colour in group]
    return [tuple(bytes.fromhex(code.ljust(8, "F"))) for code in codes]
