"""COLLADA 1.4 and 1.5 (.dae): the scene's meshes where its nodes place them, with the colours of the common profile.
Not by pycollada: it leaves out holes of polygons, parts whose material is missing, and what skins and morphs deform."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree
from trimesh import Trimesh
from trimesh.transformations import rotation_matrix
from trimesh.visual.material import PBRMaterial

from palpate.mesh.part import DRAWN_GREY, Files, Loaded, distinct, eight_bit, make_part, plain, textured, usable_normals
from palpate.mesh.polygons import strip_triangles, triangulate, with_holes

Element = Any  # of lxml, which states no types
Look = tuple[PBRMaterial | None, str | None]  # a material, and a set or a name of texture coordinates
SURFACES = ("triangles", "polylist", "polygons", "tristrips", "trifans")
# What a parameter of an effect stands for.
PARAMETER = "string(sampler2D/source | sampler2D/instance_image/@url | surface/init_from | float4 | float3)"
IDENTITY = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1"


def read(path: Path, files: Files) -> Loaded:
    """One part for each material of each instance of a geometry. Raises ValueError for what the file lacks."""
    parser = etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=True, remove_comments=True)
    root = etree.parse(path, parser).getroot()
    for element in root.iter(etree.Element):
        element.tag = etree.QName(element).localname
    (unit,) = _numbers(root.xpath("string(asset/unit/@meter)") or "1")
    return Loaded(_Document(root, files).parts(), float(unit))


def _numbers(text: str | None, dtype: type = float) -> np.ndarray:
    """Numbers (n,) of a text; decimal commas, as of some exporters in some countries, are read as points."""
    text = text or ""
    try:
        return np.array((text if "." in text else text.replace(",", ".")).split(), dtype)
    except ValueError as error:
        raise ValueError(f"a number in it can't be read, or has commas, not decimal points: {error}") from None


class _Document:
    def __init__(self, root: Element, files: Files):
        self.root, self.files = root, files
        self.ids = {element.get("id"): element for element in root.iter() if element.get("id")}
        self.materials: dict[Element, tuple[PBRMaterial, str | None]] = {}  # with the name of their texture coordinates
        self.rows: dict[Element, np.ndarray] = {}  # of each source that was read
        self.frames: dict[Element, np.ndarray] = {}  # of each node
        self.shown: list[tuple[Element, np.ndarray]] = []  # instances of geometries and controllers, with their frames

    def target(self, name: str | None, *tags: str) -> Element:
        """The element that a URL names. Raises ValueError if there is none in this file."""
        element = self.ids.get((name or "").removeprefix("#"))
        if element is None or element.tag not in tags:
            raise ValueError(f"there is no {tags[0]} {name!r} in it (of other files nothing is read)")
        return element

    def parts(self) -> list[Trimesh]:
        """The parts that the file's scene shows. Raises ValueError if it shows none."""
        shown = self.root.xpath("scene/instance_visual_scene/@url")
        for scene in [self.target(url, "visual_scene") for url in shown] or self.root.iter("visual_scene"):
            self._place(scene, np.eye(4), ())
        if not self.shown:
            raise ValueError("it has no visual scene that shows a geometry")
        return [part for instance, frame in self.shown for part in self._parts(instance, frame)]

    def _place(self, node: Element, frame: np.ndarray, within: tuple[Element, ...]) -> None:
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

    def _parts(self, instance: Element, frame: np.ndarray) -> Iterator[Trimesh]:
        """The parts that an instance of a geometry, or of a skin or a morph of one, shows."""
        geometry, positions, frame = self._shape(instance, instance.get("url"), frame)
        if positions is None:
            self.files.note(geometry.get("id"), "a geometry that is no mesh: left out")
        bound = {one.get("symbol"): one for one in instance.iter("instance_material")}
        for primitive in geometry.iterfind("mesh/*[input]") if positions is not None else ():
            if primitive.tag in SURFACES:
                look = self._material(primitive.get("material"), bound.get(primitive.get("material")))
                yield self._part(primitive, positions, frame, look, geometry.get("id") or "geometry")

    def _values(self, named: Element) -> Any:
        """Rows of the numbers, or the names, of a source that an <input> names, of its columns that have a name."""
        source = self.target(named.get("source"), "source")
        if source not in self.rows:
            accessor = source.find("technique_common/accessor")
            array, stride = self.ids[accessor.get("source").removeprefix("#")], int(accessor.get("stride", 1))
            if array.tag in ("Name_array", "IDREF_array"):
                return array.text.split()
            numbers = _numbers(array.text)[int(accessor.get("offset", 0)) :]
            rows = numbers[: len(numbers) // stride * stride].reshape(-1, stride)
            if len(rows) < int(accessor.get("count", 0)):
                raise ValueError(f"cut off: {source.get('id')} says {accessor.get('count')}, and has {len(rows):,}")
            columns = [number for number, param in enumerate(accessor.iterfind("param")) if param.get("name")]
            self.rows[source] = rows[:, columns] if len(columns) > 1 else rows
        return self.rows[source]

    def _part(self, primitive: Element, positions: np.ndarray, frame: np.ndarray, look: Look, name: str) -> Trimesh:
        """The triangles of one primitive, with its material."""
        material, texcoord_set = look
        inputs = {}  # offset of its indices and <input>, by semantic
        for entry in primitive.iterfind("input"):
            of_vertex = entry.get("semantic") == "VERTEX"
            for one in self.target(entry.get("source"), "vertices").iterfind("input") if of_vertex else [entry]:
                semantic = one.get("semantic")
                if semantic not in inputs or (semantic == "TEXCOORD" and one.get("set", "0") == texcoord_set):
                    inputs[semantic] = int(entry.get("offset", 0)), one
        if positions is not self._values(inputs["POSITION"][1]):
            inputs.pop("NORMAL", None)  # of the shape that is not deformed
        rows = _corners(primitive, positions, inputs["POSITION"][0])
        more = [semantic for semantic in ("NORMAL", "TEXCOORD", "COLOR") if semantic in inputs]
        values = {"POSITION": positions} | {semantic: self._values(inputs[semantic][1]) for semantic in more}
        offsets = {semantic: inputs[semantic][0] for semantic in values}
        if rows[:, list(offsets.values())].min(initial=0) < 0:
            raise ValueError("the index of a corner is negative")
        first, number = distinct(*(rows[:, offset] for offset in sorted(set(offsets.values()))))
        values = {semantic: value[rows[first, offsets[semantic]]] for semantic, value in values.items()}
        linear, faces, colours = frame[:3, :3], number.reshape(-1, 3), values.get("COLOR")
        if colours is not None:
            colours = eight_bit(np.c_[colours, np.ones(len(colours))][:, :4])
        return make_part(
            name,
            values["POSITION"] @ linear.T + frame[:3, 3],
            faces[:, ::-1] if np.linalg.det(linear) < 0 else faces,
            material,
            normals=usable_normals(values["NORMAL"] @ np.linalg.pinv(linear)) if "NORMAL" in values else None,
            uv=values["TEXCOORD"][:, :2] if "TEXCOORD" in values else None,
            colours=colours if material is None else None,
        )

    def _shape(self, instance: Element, url: str, frame: np.ndarray) -> tuple[Element, Any, np.ndarray]:
        """Geometry, positions (n, 3; None if it is no mesh) and frame of what an instance shows, deformed or not."""
        shape = self.target(url, "geometry", "controller")
        if shape.tag == "geometry":
            source = shape.find("mesh/vertices/input[@semantic='POSITION']")
            return shape, None if source is None else self._values(source), frame
        (deformer,) = shape.xpath("skin | morph")
        geometry, positions, frame = self._shape(instance, deformer.get("source"), frame)
        if deformer.tag == "skin":
            return geometry, *self._skinned(deformer, instance, positions)
        inputs = _inputs(deformer.find("targets"))
        weights = self._values(inputs["MORPH_WEIGHT"]).ravel()
        shapes = [self._shape(instance, name, frame)[1] for name in self._values(inputs["MORPH_TARGET"])]
        if weights.any():
            base = positions if deformer.get("method") == "RELATIVE" else positions * (1 - weights.sum())
            positions = base + np.tensordot(weights, shapes, 1)
        return geometry, positions, frame

    def _skinned(self, skin: Element, instance: Element, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions (n, 3) and their frame, as a skin's joints stand in the scene."""
        bind = _numbers(skin.findtext("bind_shape_matrix") or IDENTITY).reshape(4, 4)
        inputs = _inputs(skin.find("joints"))
        roots = [self.target(skeleton.text, "node") for skeleton in instance.iterfind("skeleton")] or [self.root]
        nodes = {key: node for root in roots for node in root.iter("node") for key in (node.get("id"), node.get("sid"))}
        frames = [self.frames.get(nodes.get(joint)) for joint in self._values(inputs["JOINT"])]
        if any(frame is None for frame in frames):
            name = skin.getparent().get("id")
            self.files.note(name, "a joint is not in the scene: the skin is shown as it was bound")
            return positions, bind
        moves = np.array(frames) @ self._values(inputs["INV_BIND_MATRIX"]).reshape(-1, 4, 4) @ bind
        if np.allclose(moves, moves[0], atol=1e-5 * np.abs(moves[0]).max()):
            return positions, moves[0]  # as it was bound
        table = skin.find("vertex_weights")
        inputs, counts = _inputs(table), _numbers(table.findtext("vcount"), int)
        pairs = _numbers(table.findtext("v"), int).reshape(-1, 1 + max(map(int, table.xpath("input/@offset"))))
        joint, number = (pairs[:, int(inputs[semantic].get("offset"))] for semantic in ("JOINT", "WEIGHT"))
        weight, move = self._values(inputs["WEIGHT"]).ravel()[number], np.r_[moves, [bind]][joint]  # -1: of no joint
        blend = np.zeros((len(positions), 4, 4))
        np.add.at(blend, np.repeat(np.arange(len(counts)), counts), weight[:, None, None] * move)
        blend[blend[:, 3, 3] == 0] = bind
        moved = np.einsum("nij,nj->ni", blend, np.c_[positions, np.ones(len(positions))])
        return moved[:, :3] / moved[:, 3:], np.eye(4)

    def _material(self, symbol: str | None, bound: Element | None) -> Look:
        """The material of a symbol of a geometry, None without one, and the set of texture coordinates it names."""
        name = symbol if bound is None else bound.get("target")
        if name is None:
            return None, None
        try:
            material = self.target(name, "material")
            effect = self.target(material.find("instance_effect").get("url"), "effect")
        except ValueError:
            name = name.removeprefix("#")
            self.files.note(name, f"there is no such material: {DRAWN_GREY}")
            return textured(None, name), None
        if material not in self.materials:
            self.materials[material] = self._appearance(effect, material.get("name") or material.get("id"))
        made, texcoord = self.materials[material]
        sets = bound.iterfind("bind_vertex_input") if bound is not None else ()
        return made, next((one.get("input_set", "0") for one in sets if one.get("semantic") == texcoord), None)

    def _appearance(self, effect: Element, name: str) -> tuple[PBRMaterial, str | None]:
        """The material of an effect, and its name of the texture's coordinates."""
        params = {one.get("sid"): one.xpath(PARAMETER).strip().removeprefix("#") for one in effect.iter("newparam")}
        shader = next(iter(effect.xpath("profile_COMMON/technique/*[diffuse or emission]")), effect)
        base = "emission" if shader.tag == "constant" else "diffuse"
        texture = shader.find(f"{base}/texture")
        colour, glow = (
            _numbers(shader.findtext(f"{of}/color") or params.get(shader.xpath(f"string({of}/param/@ref)")))
            for of in (base, "emission")
        )
        made = plain(name=name)
        if texture is not None:
            image = texture.get("texture")
            for _ in range(2):  # through a sampler, and in 1.4 a surface
                image = params.get(image, image)
            file = self.root.xpath("string(//image[@id=$id]/init_from[not(hex)])", id=image).strip()
            made = textured(self.files.picture(file.removeprefix("file://") or image), name)
        elif len(colour):
            made.baseColorFactor = [*np.clip(colour[:3], 0, 1), 1.0]
        if base == "diffuse" and glow[:3].any():
            made.emissiveFactor = np.clip(glow[:3], 0, 1)
        made.roughnessFactor = np.sqrt(2 / (2 + max([0, *_numbers(shader.findtext("shininess/float"))])))
        return made, None if texture is None else texture.get("texcoord")


def _transform(element: Element) -> np.ndarray:
    """The matrix (4, 4) of one of a node's transforms; 1 of any other element. Raises ValueError for rare ones."""
    matrix, numbers = np.eye(4), _numbers(element.text)
    match element.tag:
        case "matrix":
            matrix = numbers.reshape(4, 4)
        case "translate":
            matrix[:3, 3] = numbers
        case "scale":
            matrix[:3, :3] = np.diag(numbers)
        case "rotate" if numbers[:3].any():
            matrix = rotation_matrix(np.radians(numbers[3]), numbers[:3])
        case "lookat" | "skew":
            raise ValueError(f"a node has a <{element.tag}>, which is not read: give it a <matrix>")
    return matrix


def _inputs(element: Element) -> dict[str, Element]:
    """The <input> elements of an element by their semantics."""
    return {entry.get("semantic"): entry for entry in element.iterfind("input")}


def _corners(primitive: Element, positions: np.ndarray, place: int) -> np.ndarray:
    """Indices (3 t, k) of the corners of a primitive's triangles; positions (n, 3) are those in the column `place`."""
    width = 1 + max(map(int, primitive.xpath("input/@offset")), default=0)
    lists = [_numbers(one.text, int).reshape(-1, width) for one in primitive.iterfind("p")]
    rows = np.concatenate([np.zeros((0, width), np.int64), *lists])
    counts = np.array([len(corners) for corners in lists], np.int64)
    if primitive.tag in ("tristrips", "trifans"):
        return rows[strip_triangles(rows[:, place], counts, primitive.tag == "trifans")[0].ravel()]
    if primitive.tag == "triangles":
        counts = np.full(len(rows) // 3, 3)
    elif primitive.tag == "polylist":
        counts = _numbers(primitive.findtext("vcount"), int)
    if sum(counts) > len(rows):
        raise ValueError(f"cut off: a polylist says {sum(counts):,} corners, and has {len(rows):,}")
    made = [rows[triangulate(positions, rows[:, place], counts)[0].ravel()]]
    for polygon in primitive.iterfind("ph"):
        rings = [_numbers(one.text, int).reshape(-1, width) for one in polygon if one.tag in ("p", "h")]
        made.append(np.concatenate(rings)[with_holes([positions[ring[:, place]] for ring in rings]).ravel()])
    return np.concatenate(made)
