"""COLLADA 1.4 and 1.5 (.dae): the scene's meshes where its nodes place them, with the colours of the common profile.

Not by pycollada: it leaves out holes of polygons, parts whose material is missing, and what skins and morphs deform.
"""

from pathlib import Path

import numpy as np
from lxml import etree
from trimesh.transformations import rotation_matrix

from palpate.mesh.files import GREY as NEUTRAL
from palpate.mesh.files import Files
from palpate.mesh.formats.corners import distinct, usable_normals
from palpate.mesh.part import GREY, Loaded, make_part, plain
from palpate.mesh.polygons import triangulate, with_holes

SHADERS = ("lambert", "phong", "blinn", "constant")


def read(path: Path, files: Files) -> Loaded:
    """One part for each material of each instance of a geometry. Raises ValueError for what the file lacks."""
    parser = etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=True, remove_comments=True)
    root = etree.parse(path, parser).getroot()
    for element in root.iter(etree.Element):
        element.tag = etree.QName(element).localname
    (unit,) = _numbers(root.xpath("string(asset/unit/@meter)"), [1.0])
    return Loaded(_Document(root, files).parts(), float(unit))


def _numbers(text, default=()):
    """Numbers of a text; decimal commas, as of some exporters in some countries, are read as points."""
    words = (text or "").split()
    if not words:
        return np.array(default, dtype=float)
    try:
        return np.array(words, dtype=float)
    except ValueError:
        if "," not in text or "." in text:
            raise
    try:
        return np.array(text.replace(",", ".").split(), dtype=float)
    except ValueError as error:
        raise ValueError(f"its numbers have commas, not decimal points: {error}") from None


class _Document:
    """What a file's elements name, by their ids."""

    def __init__(self, root, files):
        self.root, self.files, self.materials, self.bases = root, files, {}, {}
        self.ids = {element.get("id"): element for element in root.iter() if element.get("id")}
        self.frames, self.shown = {}, []  # of each node; instances of geometries and controllers, with theirs

    def target(self, name, tag):
        """The element that a URL names. Raises ValueError if there is none in this file."""
        element = self.ids.get((name or "").removeprefix("#"))
        if element is None or element.tag != tag:
            raise ValueError(f"there is no {tag} {name!r} in it (of other files nothing is read)")
        return element

    def parts(self):
        shown = self.root.findall("scene/instance_visual_scene")
        for scene in [self.target(one.get("url"), "visual_scene") for one in shown] or self.root.iter("visual_scene"):
            self._place(scene, np.eye(4), ())
        if not self.shown:
            raise ValueError("it has no visual scene that shows a geometry")
        return [part for instance, frame in self.shown for part in self._parts(instance, frame)]

    def _place(self, node, frame, within):
        """Note the frames of a node and of those below, and what they show."""
        if node in within:
            raise ValueError(f"node {node.get('id')!r} is within itself")
        for child in node:
            frame = frame @ _transform(child)
        self.frames[node] = frame
        for child in node:
            if child.tag in ("node", "instance_node"):
                inner = child if child.tag == "node" else self.target(child.get("url"), "node")
                self._place(inner, frame, (*within, node))
            elif child.tag in ("instance_geometry", "instance_controller"):
                self.shown.append((child, frame))

    def _parts(self, instance, frame):
        geometry, positions, frame = self._shape(instance, instance.get("url"), frame)
        bound = {each.get("symbol"): each for each in instance.iter("instance_material")}
        for primitive in geometry.iterfind("mesh/*[input]"):
            if primitive.tag != "vertices":
                symbol = primitive.get("material")
                part = self._part(primitive, positions, frame, symbol, bound.get(symbol))
                if part is not None:
                    yield part

    def _positions(self, geometry):
        """Positions (n, 3) of a geometry's vertices; none, and a note, if it is no mesh."""
        source = geometry.find("mesh/vertices/input[@semantic='POSITION']")
        if source is None:
            self.files.note(geometry.get("id"), "a geometry that is no mesh: left out")
            return np.zeros((0, 3))
        if geometry not in self.bases:
            self.bases[geometry] = self._values(source)
        return self.bases[geometry]

    def _values(self, named):
        """Rows of the numbers of a source that an <input> names, without columns that have no name."""
        source = self.target(named.get("source"), "source")
        accessor = source.find("technique_common/accessor")
        stride, start = int(accessor.get("stride", 1)), int(accessor.get("offset", 0))
        numbers = _numbers(self.ids[accessor.get("source").removeprefix("#")].text)[start:]
        rows = numbers[: len(numbers) // stride * stride].reshape(-1, stride)
        if len(rows) < int(accessor.get("count", 0)):
            raise ValueError(f"cut off: {source.get('id')} says {accessor.get('count')}, and has {len(rows):,}")
        columns = [number for number, param in enumerate(accessor.iterfind("param")) if param.get("name")]
        return rows[:, columns] if len(columns) > 1 else rows

    def _part(self, primitive, positions, frame, symbol, bound):
        """The triangles of one material; None of lines."""
        inputs = []  # semantic, offset, set, and the input itself
        for entry in primitive.iterfind("input"):
            of_vertex = entry.get("semantic") == "VERTEX"
            inner = self.target(entry.get("source"), "vertices").iterfind("input") if of_vertex else [entry]
            inputs += [(one.get("semantic"), int(entry.get("offset", 0)), one.get("set", "0"), one) for one in inner]
        place = next(offset for semantic, offset, *_ in inputs if semantic == "POSITION")
        rows = _corners(primitive, positions, place, 1 + max(offset for _, offset, *_ in inputs))
        if rows is None:
            return None
        material, coordinates = self._material(symbol, bound)
        chosen = {"POSITION": (place, positions)}
        for semantic, offset, number, source in inputs:
            wanted = semantic != "TEXCOORD" or coordinates in (None, number)
            if semantic in ("NORMAL", "TEXCOORD", "COLOR") and semantic not in chosen and wanted:
                chosen[semantic] = offset, self._values(source)
        for offset, values in chosen.values():
            if len(rows) and not 0 <= rows[:, offset].min() <= rows[:, offset].max() < len(values):
                raise ValueError(f"a corner refers to number {rows[:, offset].max()} of {len(values)}")
        first, number = distinct(*(rows[:, offset] for offset in sorted({offset for offset, _ in chosen.values()})))
        if positions is not self.bases[primitive.getparent().getparent()]:
            chosen.pop("NORMAL", None)  # those of another shape
        held = {semantic: values[rows[first, offset]] for semantic, (offset, values) in chosen.items()}
        linear = frame[:3, :3]
        faces = number.reshape(-1, 3)
        colours = held.get("COLOR") if material is None else None
        if colours is not None:
            colours = np.round(255 * np.clip(np.c_[colours, np.ones(len(colours))][:, :4], 0, 1)).astype(np.uint8)
        return make_part(
            primitive.getparent().getparent().get("id") or "geometry",
            held["POSITION"] @ linear.T + frame[:3, 3],
            faces[:, ::-1] if np.linalg.det(linear) < 0 else faces,
            material,
            normals=usable_normals(held["NORMAL"] @ np.linalg.pinv(linear)) if "NORMAL" in held else None,
            uv=held["TEXCOORD"][:, :2] if "TEXCOORD" in held else None,
            colours=colours,
        )

    def _shape(self, instance, url, frame):
        """Geometry, positions (n, 3) and frame of what an instance of a geometry, a skin or a morph shows."""
        shape = self.ids.get((url or "").removeprefix("#"))
        if shape is None or shape.tag != "controller":
            geometry = self.target(url, "geometry")
            return geometry, self._positions(geometry), frame
        deformer = next(child for child in shape if child.tag in ("skin", "morph"))
        geometry, positions, frame = self._shape(instance, deformer.get("source"), frame)
        if deformer.tag == "skin":
            return geometry, *self._skinned(shape.get("id"), deformer, instance, positions)
        inputs = _inputs(deformer.find("targets"))
        weights = self._values(inputs["MORPH_WEIGHT"]).ravel()
        shapes = [self._positions(self.target(name, "geometry")) for name in self._names(inputs["MORPH_TARGET"])]
        if weights.any():
            base = positions if deformer.get("method") == "RELATIVE" else positions * (1 - weights.sum())
            positions = base + np.tensordot(weights, shapes, 1)
        return geometry, positions, frame

    def _skinned(self, name, skin, instance, positions):
        """Positions (n, 3) and their frame, as a skin's joints stand in the scene."""
        bind = _numbers(skin.findtext("bind_shape_matrix"), np.eye(4).ravel()).reshape(4, 4)
        inputs = _inputs(skin.find("joints"))
        roots = [self.target(skeleton.text, "node") for skeleton in instance.iterfind("skeleton")] or [self.root]
        nodes = {key: node for root in roots for node in root.iter("node") for key in (node.get("id"), node.get("sid"))}
        frames = [self.frames.get(nodes.get(joint)) for joint in self._names(inputs["JOINT"])]
        if any(frame is None for frame in frames):
            self.files.note(name, "a skin one of whose joints is not in the scene: shown as it was bound")
            return positions, bind
        moves = np.array(frames) @ self._values(inputs["INV_BIND_MATRIX"]).reshape(-1, 4, 4) @ bind
        if np.allclose(moves, moves[0], atol=1e-5 * np.abs(moves[0]).max()):
            return positions, moves[0]  # as it was bound
        table = skin.find("vertex_weights")
        inputs, counts, pairs = _inputs(table), _integers(table.findtext("vcount")), _integers(table.findtext("v"))
        pairs = pairs.reshape(-1, 1 + max(int(entry.get("offset")) for entry in inputs.values()))
        joint, number = (pairs[:, int(inputs[semantic].get("offset"))] for semantic in ("JOINT", "WEIGHT"))
        weight, move = self._values(inputs["WEIGHT"]).ravel()[number], np.r_[moves, [bind]][joint]  # -1: of no joint
        vertex = np.repeat(np.arange(len(counts)), counts)
        moved = np.einsum("kij,kj->ki", move[:, :3, :3], positions[vertex]) + move[:, :3, 3]
        x, y, z, total = (
            np.bincount(vertex, weight * axis, len(positions)) for axis in (*moved.T, np.ones(len(vertex)))
        )
        still = positions @ bind[:3, :3].T + bind[:3, 3]
        blended = np.stack([x, y, z], axis=1) / np.where(total, total, 1)[:, None]
        return np.where(total[:, None] == 0, still, blended), np.eye(4)

    def _names(self, named):
        source = self.target(named.get("source"), "source")
        return next(each.text for each in source if each.tag in ("Name_array", "IDREF_array")).split()

    def _material(self, symbol, bound):
        """The material of a symbol of a geometry, None without one, and the set of texture coordinates it names."""
        name = symbol if bound is None else bound.get("target")
        if name is None:
            return None, None
        try:
            material = self.target(name, "material")
            effect = self.target(material.find("instance_effect").get("url"), "effect")
        except ValueError:
            name = name.removeprefix("#")
            self.files.note(name, f"there is no such material: {NEUTRAL}")
            return plain(GREY, name), None
        if material not in self.materials:
            self.materials[material] = self._appearance(effect, material.get("name") or material.get("id"))
        made, coordinates = self.materials[material]
        sets = bound.iterfind("bind_vertex_input") if bound is not None else ()
        return made, {each.get("semantic"): each.get("input_set", "0") for each in sets}.get(coordinates)

    def _appearance(self, effect, name):
        """The material of an effect, and its name of the texture's coordinates."""
        params = {each.get("sid"): each for each in effect.iter("newparam")}
        shader = next((each for each in effect.iterfind("profile_COMMON/technique/*") if each.tag in SHADERS), effect)
        base = "emission" if shader.tag == "constant" else "diffuse"
        colour, texture = _colour(shader.find(base), params), shader.find(f"{base}/texture")
        made, coordinates = plain(name=name), None
        if texture is not None:
            image = self._picture(texture.get("texture"), params)
            made = plain(GREY if image is None else 1.0, name)
            made.baseColorTexture, coordinates = image, texture.get("texcoord")
        elif colour is not None:
            made.baseColorFactor = [*np.clip(colour[:3], 0, 1), 1.0]
        glow = _colour(shader.find("emission"), params)
        if glow is not None and shader.tag != "constant" and glow[:3].any():
            made.emissiveFactor = np.clip(glow[:3], 0, 1)
        shininess = _numbers(shader.findtext("shininess/float"), [0.0])[0]
        made.roughnessFactor = np.sqrt(2 / (2 + max(shininess, 0)))
        return made, coordinates

    def _picture(self, name, params):
        """The image of a texture: named by itself, or through a sampler, and in 1.4 a surface."""
        for _ in range(2):
            if name in params:
                texts = "sampler2D/source | surface/init_from | sampler2D/instance_image/@url"
                name = params[name].xpath(f"string({texts})").strip().removeprefix("#")
        image = self.ids.get(name)
        if image is None or image.tag != "image":
            self.files.note(name, f"there is no such image: {NEUTRAL}")
            return None
        held = image.findtext("data") or image.findtext("init_from/hex")
        if held:
            return self.files.picture(name, bytes.fromhex("".join(held.split())))
        file = image.findtext("init_from/ref") or image.findtext("init_from") or ""
        return self.files.picture(file.strip().removeprefix("file://"))


def _colour(element, params):
    """The RGBA that an element states, or a parameter that it names; None if it states none."""
    if element is None:
        return None
    param = params.get(element.xpath("string(param/@ref)"), element)
    text = element.findtext("color") or param.findtext("float4") or param.findtext("float3")
    return _numbers(text) if text else None


def _transform(element):
    """The matrix (4, 4) of one of a node's transforms; 1 of any other element."""
    matrix = np.eye(4)
    if element.tag not in ("matrix", "translate", "scale", "rotate", "lookat", "skew"):
        return matrix
    numbers = _numbers(element.text)
    if element.tag == "matrix":
        return numbers.reshape(4, 4)
    if element.tag == "translate":
        matrix[:3, 3] = numbers
    elif element.tag == "scale":
        matrix[:3, :3] = np.diag(numbers)
    elif element.tag == "rotate":
        if numbers[:3].any():
            matrix = rotation_matrix(np.radians(numbers[3]), numbers[:3])
    elif element.tag == "lookat":
        eye, interest, up = numbers.reshape(3, 3)
        z = (eye - interest) / np.linalg.norm(eye - interest)
        x = np.cross(up, z) / np.linalg.norm(np.cross(up, z))
        matrix[:3] = np.stack([x, np.cross(z, x), z, eye], axis=1)
    else:  # as RenderMan's: along the second axis, by the angle at the first
        first, second = (axis / np.linalg.norm(axis) for axis in numbers[1:].reshape(2, 3))
        matrix[:3, :3] += np.tan(np.radians(numbers[0])) * np.outer(second, first)
    return matrix


def _inputs(element):
    return {entry.get("semantic"): entry for entry in element.iterfind("input")}


def _integers(text):
    return np.array((text or "").split(), dtype=np.int64)


def _corners(primitive, positions, place, width):
    """Indices (3 t, width) of the corners of a primitive's triangles; None of lines.

    positions (n, 3): of the vertices; place: the column of their indices.
    """
    lists = [_integers(each.text).reshape(-1, width) for each in primitive.iterfind("p")]
    rows = np.concatenate(lists or [np.zeros((0, width), np.int64)])
    if primitive.tag in ("triangles", "polylist", "polygons"):
        counts = _integers(primitive.findtext("vcount"))
        if primitive.tag != "polylist":
            counts = [3] * (len(rows) // 3) if primitive.tag == "triangles" else [len(corners) for corners in lists]
        if sum(counts) > len(rows):
            raise ValueError(f"cut off: a polylist says {sum(counts):,} corners, and has {len(rows):,}")
        made = [rows[triangulate(positions, rows[:, place], counts)[0].ravel()]]
        for polygon in primitive.iterfind("ph"):
            rings = [_integers(each.text).reshape(-1, width) for each in polygon if each.tag in ("p", "h")]
            made.append(np.concatenate(rings)[with_holes([positions[ring[:, place]] for ring in rings]).ravel()])
        return np.concatenate(made)
    if primitive.tag not in ("tristrips", "trifans"):
        return None
    made, fan = [rows[:0]], primitive.tag == "trifans"
    for corners in lists:
        start = np.arange(len(corners) - 2)
        odd = 0 if fan else start % 2
        made.append(corners[np.stack([0 * start if fan else start + odd, start + 1 - odd, start + 2], axis=1).ravel()])
    return np.concatenate(made)
