"""3MF, its core and production: the objects that its build shows, without colours, textures and supports."""

import zipfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree
from trimesh import Trimesh

from palpate.mesh.part import Files, Loaded, make_part, numbers

Element = Any  # of lxml, which states no types
MOST_UNPACKED, LARGEST_RATIO = 500e6, 100  # bytes of an unpacked file; these over its own, where 10 is common
UNITS = {"micron": 1e-6, "millimeter": 1e-3, "centimeter": 0.01, "inch": 0.0254, "foot": 0.3048, "meter": 1.0}
MODEL = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
# Extensions without which, or with what is read of them, the shape is the same (the last part of their names).
KNOWN = ("production/2015/06", "material/2015/02", "trianglesets/2021/07")


def read(path: Path, files: Files) -> Loaded:
    """One part for each object as it is built. Raises ValueError if it requires an extension that is not read."""
    with zipfile.ZipFile(path) as archive:
        size = sum(file.file_size for file in archive.infolist())
        if size > max(MOST_UNPACKED, LARGEST_RATIO * path.stat().st_size):
            raise ValueError(f"its {path.stat().st_size / 1e6:.1f} MB are {size / 1e6:,.0f} MB unpacked")
        names = {name.lower(): name for name in archive.namelist()}
        parts: list[Trimesh] = []

        @cache
        def model(name: str) -> tuple[dict[str, Element], Element]:
            """The objects of a model file, by their ids, and its root."""
            root = _parse(archive.read(names.get(name.lstrip("/").lower(), name)))
            spaces = [root.nsmap.get(prefix, prefix) for prefix in root.get("requiredextensions", "").split()]
            if missing := [space for space in spaces if not space.endswith(KNOWN)]:
                raise ValueError(f"it requires an extension that is not read: {', '.join(missing)}")
            return {shape.get("id"): shape for shape in root.iterfind("{*}resources/{*}object")}, root

        relations = _parse(archive.read("_rels/.rels")) if "_rels/.rels" in names else ()
        start = next((one.get("Target") for one in relations if one.get("Type") == MODEL), "3D/3dmodel.model")
        _, root = model(start)

        def show(reference: Element, name: str, frame: np.ndarray, within: tuple[Element, ...]) -> None:
            """Note the parts that a build item or a component of a model file shows."""
            path = (value for key, value in reference.attrib.items() if key.endswith("}path"))
            name, number = next(path, name), reference.get("objectid")
            objects, _ = model(name)
            shape = objects.get(number)
            if shape is None or shape in within:
                raise ValueError(f"object {number} of {name} is missing, or is within itself")
            if shape.get("type") in ("support", "solidsupport"):
                return
            rows = np.array((reference.get("transform") or "1 0 0 0 1 0 0 0 1 0 0 0").split(), dtype=float)
            frame = np.c_[rows.reshape(4, 3), [0, 0, 0, 1]] @ frame
            parts.append(_part(shape, frame, files))
            for component in shape.iterfind("{*}components/{*}component"):
                show(component, name, frame, (*within, shape))

        for item in root.iterfind("{*}build/{*}item"):
            show(item, start, np.eye(4), ())
    return Loaded(parts, UNITS[root.get("unit", "millimeter")])


def _parse(data: bytes) -> Element:
    """The root of an XML file, without what it names outside."""
    return etree.fromstring(data, etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=True))


def _part(shape: Element, frame: np.ndarray, files: Files) -> Trimesh:
    """An object's triangles; frame: the matrix (4, 4) of its build, for rows of coordinates."""
    name, triangles = shape.get("name") or f"object {shape.get('id')}", list(shape.iterfind(".//{*}triangle"))
    corners = shape.iterfind(".//{*}vertex")
    vertices = numbers(" ".join([corner.get(axis) for corner in corners for axis in "xyz"]).encode()).reshape(-1, 3)
    faces = np.array([int(face.get(key)) for face in triangles for key in ("v1", "v2", "v3")], np.int64).reshape(-1, 3)
    if shape.get("pid") or any(face.get("pid") for face in triangles):
        files.note(files.path.name, "its colours and textures are not read: drawn in a plain grey")
    vertices = vertices @ frame[:3, :3] + frame[3, :3]
    return make_part(name, vertices, faces[:, ::-1] if np.linalg.det(frame) < 0 else faces)
