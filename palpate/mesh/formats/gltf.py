"""glTF 2.0 (.gltf, .glb): what its default scene shows at rest, with morph targets at their default weights and skins.

Numbers of sections are those of the specification (Khronos, glTF 2.0). All materials become metallic and rough ones:

- metallic and roughness are the file's, else 1; a part without a material is not metal;
- unlit: metallic 0, roughness 1, and the base colour alone;
- specular and glossiness: converted by trimesh, as Khronos' example does it;
- transmission: blended, its opacity 1 less 0.9 of what is transmitted, so that what is behind it is seen;
- textures lie and wrap as the base colour's, or else the first. One that lies otherwise is left out;
- textures of transmission and of occlusion are not read.
"""

import base64
import re
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import unquote_to_bytes

import numpy as np
import trimesh
from numpy.typing import ArrayLike
from PIL.Image import Image, fromarray
from scipy.spatial.transform import Rotation
from trimesh.visual.gloss import specular_to_pbr
from trimesh.visual.material import PBRMaterial

from palpate.mesh.part import DRAWN_GREY, GREY, Files, Loaded, eight_bit, make_part, plain
from palpate.mesh.polygons import strip_triangles
from palpate.named_files import gltf_tree

COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}  # 3.6.2.2
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
TRIANGLES, STRIP, FAN = 4, 5, 6  # modes of a primitive; 0 to 3 are points and lines (3.7.2.1)
MOVES = ("translation", "rotation", "scale")
WRAPS = {33071: "clamp", 33648: "mirror"}  # of a sampler; others repeat
ELEMENTS_A_BYTE = 100  # of the file, at most, of an accessor without data of its own: zeros, or sparse
STRIP_ROWS = 256  # of a picture that are converted at once: a whole one takes gigabytes as numbers
CLEAREST = 0.1  # opacity of a material that transmits all light
DRACO = "KHR_draco_mesh_compression"
REMEDIES = {  # of extensions by a word of their names
    "draco": "import it into Blender, which reads it, and export it without compression",
    "meshopt": "write it without, e.g. gltfpack -i in.glb -o out.glb -noq",
}
# Extensions that are read, and those that change neither shape nor base colour.
KNOWN = re.compile(
    "KHR_(mesh_quantization|node_visibility|(materials|texture|lights|animation|xmp)_.*)"
    "|EXT_(mesh_gpu_instancing|(texture|lights)_.*)"
)
Tree = dict[str, Any]


class Place(NamedTuple):
    """How a texture lies on a part: the number of its coordinates, their offset, rotation and scale; how it wraps."""

    number: int = 0
    transform: tuple[tuple[float, float], float, tuple[float, float]] = ((0, 0), 0, (1, 1))
    wrap: tuple[str, str] | None = None


def read(path: Path, files: Files) -> Loaded:
    """One part for each primitive of a node, or of an instance of it. Raises ValueError if the file needs what is not
    read, and that, LookupError, TypeError or AttributeError if it is damaged."""
    return Loaded(_Document(path, files).parts())


class _Document:
    def __init__(self, path: Path, files: Files):
        self.files, data = files, path.read_bytes()
        self.tree, start = gltf_tree(path)
        version = self.tree.get("asset", {}).get("version", "of no version")
        if str(version).split(".")[0] != "2":
            raise ValueError(f"it is glTF {version}, not 2.0: convert it, e.g. gltf-pipeline -i old.gltf -o new.gltf")
        for name in self.tree.get("extensionsRequired", []):
            if not KNOWN.fullmatch(name):
                raise _not_read("it", name)
        self.nodes = self.tree.get("nodes", [])
        length = int.from_bytes(data[start - 8 : start - 4], "little") if path.suffix.lower() == ".glb" else 0
        self.chunk = memoryview(data)[start : start + length]
        self.buffers = [self._buffer(*numbered) for numbered in enumerate(self.tree.get("buffers", []))]
        self.size = len(data) + sum(map(len, self.buffers))
        self.worlds = self._worlds()
        self.picture, self.material = cache(self._picture), cache(self._material)

    def _buffer(self, number: int, given: Tree) -> bytes | memoryview:
        """A buffer's content; empty if it only stands for what is compressed (EXT_meshopt_compression)."""
        if "uri" not in given and (number or given.get("extensions")):
            return b""
        data = self._uri(given["uri"]) if "uri" in given else self.chunk
        if len(data) < given["byteLength"]:
            raise ValueError(f"cut off: buffer {number} says {given['byteLength']:,} bytes, and has {len(data):,}")
        return data

    def _uri(self, uri: str) -> bytes:
        """The content that a URI names or holds."""
        if uri[:5].lower() != "data:":
            return self.files.read(uri)
        head, _, body = uri.partition(",")
        data = unquote_to_bytes(body)
        return base64.b64decode(data) if head.endswith(";base64") else data

    def _view(self, number: int) -> memoryview:
        view = self.tree["bufferViews"][number]
        buffer, start = self.buffers[view["buffer"]], view.get("byteOffset", 0)
        if not buffer and view.get("extensions"):
            raise _not_read("it", next(iter(view["extensions"])))
        return memoryview(buffer)[start : start + view["byteLength"]]

    def _elements(self, given: Tree, count: int, component: int, width: int) -> np.ndarray:
        """Elements (count, width) in a buffer view; given: an accessor, or the indices or values of a sparse one."""
        data, start, dtype = self._view(given["bufferView"]), given.get("byteOffset", 0), COMPONENTS[component]
        size = np.dtype(dtype).itemsize
        stride = self.tree["bufferViews"][given["bufferView"]].get("byteStride", size * width)
        if start + (count - 1) * stride + size * width > len(data):
            raise ValueError(f"cut off: {count:,} elements in a buffer view of {len(data):,} bytes")
        return np.ndarray((count, width), dtype, data, start, (stride, size))

    def accessor(self, number: int) -> np.ndarray:
        """Elements (count, width) of an accessor as they are stored."""
        given = self.tree["accessors"][number]
        count, component, width = given["count"], given["componentType"], WIDTHS[given["type"]]
        if not 0 <= count <= ELEMENTS_A_BYTE * self.size:
            raise ValueError(f"accessor {number} says {count:,} elements, and the file has {self.size:,} bytes")
        values = np.zeros((count, width), COMPONENTS[component])
        if "bufferView" in given:
            values = self._elements(given, count, component, width)
        if few := given.get("sparse"):
            places = self._elements(few["indices"], few["count"], few["indices"]["componentType"], 1)[:, 0]
            values = values.copy()
            values[places] = self._elements(few["values"], few["count"], component, width)
        return values

    def floats(self, number: int, normalise: bool = False) -> np.ndarray:
        """Elements as floats; integers, if the accessor says so or normalise, in parts of their largest."""
        values = self.accessor(number)
        if values.dtype.kind == "f":
            return values
        parts = normalise or self.tree["accessors"][number].get("normalized")
        return np.maximum(values / np.iinfo(values.dtype).max, -1.0) if parts else values.astype(float)

    def _worlds(self) -> dict[int, np.ndarray]:
        """Matrices (4, 4) from each node to the file's frame."""
        children = {child for node in self.nodes for child in node.get("children", [])}
        waiting, worlds = [(number, np.eye(4)) for number in range(len(self.nodes)) if number not in children], {}
        self.roots = [number for number, _ in waiting]
        for number, above in waiting:  # which grows on the way
            if number in worlds:
                raise ValueError(f"node {number} is a child of two nodes")
            node = self.nodes[number]
            local = _matrices(**{key: [node[key]] for key in MOVES if key in node})[0]
            worlds[number] = above @ (np.reshape(node["matrix"], (4, 4)).T.astype(float) if "matrix" in node else local)
            waiting += [(child, worlds[number]) for child in node.get("children", [])]
        if cycle := sorted(set(range(len(self.nodes))) - set(worlds)):
            raise ValueError(f"nodes {cycle} are below themselves (a cycle)")
        return worlds

    def parts(self) -> list[trimesh.Trimesh]:
        """What the default scene, else the first, else every root node shows, in the order of the nodes' names."""
        scenes = self.tree.get("scenes")
        waiting = list(scenes[self.tree.get("scene", 0)].get("nodes", []) if scenes else self.roots)
        shown, made = set(), []
        for number in waiting:  # which grows on the way
            if _extension(self.nodes[number], "KHR_node_visibility").get("visible", True):
                shown.add((self.nodes[number].get("name", ""), number))
                waiting += self.nodes[number].get("children", [])
        for _, number in sorted(shown):
            if "mesh" in self.nodes[number]:
                for place, primitive in enumerate(self.tree["meshes"][self.nodes[number]["mesh"]]["primitives"]):
                    made += self._primitive(number, place, primitive)
        return made

    def _primitive(self, number: int, place: int, primitive: Tree) -> list[trimesh.Trimesh]:
        """The parts that a node makes of a primitive of its mesh: one, or one an instance."""
        node = self.nodes[number]
        mesh = self.tree["meshes"][node["mesh"]]
        name = mesh.get("name", str(node["mesh"])) + (f"_{place}" if place else "")
        attributes, mode = primitive["attributes"], primitive.get("mode", TRIANGLES)
        if mode not in (TRIANGLES, STRIP, FAN) or "POSITION" not in attributes:
            self.files.note(name, "points or lines, which have no surface: left out")
            return []
        positions = self.tree["accessors"][attributes["POSITION"]]
        if _extension(primitive, DRACO) and "bufferView" not in positions:
            raise _not_read(f"mesh {name}", DRACO)
        weights = node.get("weights", mesh.get("weights", []))

        def values(key: str) -> np.ndarray:
            """An attribute with its morph targets added."""
            total = self.floats(attributes[key], key == "COLOR_0")
            for weight, target in zip(weights, primitive.get("targets", []), strict=False):
                if weight and key in target:
                    total = total.astype(float) + weight * self.floats(target[key], key == "COLOR_0")
            if len(total) != positions["count"]:
                raise ValueError(f"mesh {name} has {len(total):,} elements of {key}, and not one a position")
            return total

        vertices = values("POSITION").astype(float)
        normals = values("NORMAL") if "NORMAL" in attributes else None
        order = self.accessor(primitive["indices"])[:, 0] if "indices" in primitive else np.arange(len(vertices))
        if mode != TRIANGLES:
            order = order[strip_triangles(order, [len(order)], mode == FAN)[0]]
        elif len(order) % 3:
            raise ValueError(f"mesh {name} has {len(order):,} corners of triangles, not a multiple of 3")
        faces = order.reshape(-1, 3)
        material, where = self.material(primitive.get("material"), frozenset(attributes))
        uv = wrap = colours = None
        if where is not None:
            wrap = where.wrap
            if (key := f"TEXCOORD_{where.number}") in attributes:
                offset, rotation, scale = where.transform  # KHR_texture_transform's; anticlockwise, as seen
                cos, sin, uv = np.cos(rotation), np.sin(rotation), values(key)
                turned = uv * np.array(scale) @ np.array([[cos, -sin], [sin, cos]])
                uv = (turned + np.array(offset)).astype(uv.dtype)
                uv[:, 1] = 1.0 - uv[:, 1]  # v upwards
        if "COLOR_0" in attributes:
            colours = eight_bit(values("COLOR_0"))
            if colours.shape[1] == 3 or material is None or material.alphaMode in (None, "OPAQUE"):
                colours = np.column_stack([colours[:, :3], np.full(len(colours), 255, np.uint8)])
        placed = []
        for matrix in self._placements(node, number, attributes):
            linear, turned = matrix[..., :3, :3], None
            with np.errstate(invalid="ignore", over="ignore"):  # vertices that are not finite are looked for later
                points = np.einsum("...ij,...j->...i", linear, vertices) + matrix[..., :3, 3]
                if normals is not None:
                    turned = np.einsum("...ji,...j->...i", np.linalg.pinv(linear), normals)
            sides = faces[:, ::-1] if np.median(np.linalg.det(linear)) < 0 else faces  # of what is mirrored
            placed.append(make_part(name, points, sides, material, normals=turned, uv=uv, colours=colours, wrap=wrap))
        return placed

    def _placements(self, node: Tree, number: int, attributes: Tree) -> list[np.ndarray]:
        """Matrices to the file's frame: one (4, 4), or one an instance, or one (n, 4, 4) of a skin's n vertices."""
        if "skin" in node and "JOINTS_0" in attributes:  # the node's own transform is ignored (3.7.3.3)
            skin = self.tree["skins"][node["skin"]]
            joints = np.stack([self.worlds[joint] for joint in skin["joints"]])
            if "inverseBindMatrices" in skin:
                inverse = self.accessor(skin["inverseBindMatrices"])[: len(joints)]
                joints = joints @ inverse.reshape(-1, 4, 4).transpose(0, 2, 1)
            keys = sorted(key for key in attributes if key.startswith("JOINTS_"))
            numbers = np.hstack([self.accessor(attributes[key]) for key in keys])
            weights = np.hstack([self.floats(attributes[key.replace("JOINTS", "WEIGHTS")]) for key in keys])
            total = weights.sum(axis=1, dtype=float)[:, None, None]
            matrices = sum(w[:, None, None] * joints[n] for n, w in zip(numbers.T, weights.T, strict=True))
            return [np.where(total > 0, matrices / np.where(total > 0, total, 1), joints[0])]
        if instancing := _extension(node, "EXT_mesh_gpu_instancing"):
            moved = instancing["attributes"]
            moved = {key: self.floats(moved[key.upper()]) for key in MOVES if key.upper() in moved}
            return list(self.worlds[number] @ _matrices(**moved))
        return [self.worlds[number]]

    def _material(self, number: int | None, attributes: frozenset[str]) -> tuple[PBRMaterial | None, Place | None]:
        """A material for a part with such attributes, and how its textures lie."""
        if number is None:
            return None, None
        given = self.tree["materials"][number]
        name, extensions = given.get("name"), given.get("extensions", {})
        unlit, glossy = "KHR_materials_unlit" in extensions, extensions.get("KHR_materials_pbrSpecularGlossiness")
        base, shine, factors = "baseColorTexture", "metallicRoughnessTexture", given.get("pbrMetallicRoughness", {})
        if glossy is not None and not unlit:
            base, shine, factors = "diffuseTexture", "specularGlossinessTexture", glossy
        keys = (base,) if unlit else (base, shine, "normalTexture", "emissiveTexture")
        infos = {key: info for key in keys if (info := factors.get(key, given.get(key)))}
        where = next((self._where(info) for info in infos.values()), Place())
        label, pictures = name or f"material {number}", {}
        for key, info in reversed(infos.items()):  # the colour last: what follows from its loss is said of a picture
            follows = DRAWN_GREY if key == base else "left out"
            if self._where(info)[:2] != where[:2] or f"TEXCOORD_{where.number}" not in attributes:
                self.files.note(f"{label}, {key}", f"it has coordinates of its own, or none: {follows}")
            elif (picture := self.picture(info["index"], follows)) is not None:
                pictures[key] = picture
        lost = infos.keys() - pictures.keys()
        if base in lost:
            return plain(GREY, name), None
        factors = {key: value for key, value in factors.items() if key.endswith("Factor")}
        if base == "diffuseTexture":
            factors = _from_glossy(factors | ({"specularFactor": [0.04] * 3} if shine in lost else {}), pictures)
        made = {"baseColorFactor": [1.0] * 4, "metallicFactor": 1.0, "roughnessFactor": 1.0, **pictures, **factors}
        if unlit or shine in lost:  # what a lost texture would say of metal is not known
            made |= {"metallicFactor": 0.0} | ({"roughnessFactor": 1.0} if unlit else {})
        if "emissiveFactor" in given and not unlit and "emissiveTexture" not in lost:
            strength = _extension(given, "KHR_materials_emissive_strength").get("emissiveStrength", 1.0)
            made["emissiveFactor"] = strength * np.array(given["emissiveFactor"], dtype=float)
        made["baseColorFactor"] = np.array(made["baseColorFactor"], dtype=float)
        made |= {key: given[key] for key in ("alphaMode", "alphaCutoff", "doubleSided") if key in given}
        metal = 0 if "metallicRoughnessTexture" in made else made["metallicFactor"]
        through = _extension(given, "KHR_materials_transmission").get("transmissionFactor", 0) * (1 - metal)
        if through > 0:
            if made.get("alphaMode", "OPAQUE") == "OPAQUE":  # whose alpha does not count
                made["baseColorFactor"][3] = 1.0
                if "baseColorTexture" in made:
                    made["baseColorTexture"] = made["baseColorTexture"].convert("RGB")
            made["baseColorFactor"][3] *= 1 - (1 - CLEAREST) * through
            made["alphaMode"] = "BLEND"
        return PBRMaterial(name=name, **made), where

    def _where(self, info: Tree) -> Place:
        """How a texture lies, by a material's reference to it."""
        moved, texture = _extension(info, "KHR_texture_transform"), self.tree["textures"][info["index"]]
        sampler = self.tree["samplers"][texture["sampler"]] if "sampler" in texture else {}
        wrap = WRAPS.get(sampler.get("wrapS", 0), "repeat"), WRAPS.get(sampler.get("wrapT", 0), "repeat")
        transform = tuple(moved.get("offset", (0, 0))), moved.get("rotation", 0), tuple(moved.get("scale", (1, 1)))
        return Place((info | moved).get("texCoord", 0), transform, None if wrap == ("repeat", "repeat") else wrap)

    def _picture(self, number: int, follows: str) -> Image | None:
        """A texture's picture; None, and a note of what follows, if it can't be used."""
        texture = self.tree["textures"][number]
        others = (given["source"] for given in texture.get("extensions", {}).values() if "source" in given)
        source = texture.get("source", next(others, None))
        if source is None:
            self.files.note(f"texture {number}", f"it has no image: {follows}")
            return None
        image = self.tree["images"][source]
        uri = image.get("uri", "data:")
        if uri[:5].lower() != "data:":
            return self.files.picture(uri, None, follows)
        data = bytes(self._view(image["bufferView"])) if "bufferView" in image else self._uri(uri)
        return self.files.picture(image.get("name") or f"image {source}", data, follows)


def _not_read(what: str, extension: str) -> ValueError:
    """The error about a part of the file that needs an extension."""
    remedy = next((remedy for word, remedy in REMEDIES.items() if word in extension), "export it without")
    return ValueError(f"{what} needs the extension {extension}, which is not read: {remedy}")


def _extension(given: Tree, name: str) -> Tree:
    """What an extension adds to a part of the JSON; empty if it is not used there."""
    return given.get("extensions", {}).get(name, {})


def _matrices(
    translation: ArrayLike = ((0, 0, 0),), rotation: ArrayLike = ((0, 0, 0, 1),), scale: ArrayLike = ((1, 1, 1),)
) -> np.ndarray:
    """Matrices (n, 4, 4) of translations (n, 3), rotations (n, 4; w is last) and scales (n, 3)."""
    count = max(map(len, map(np.asarray, (translation, rotation, scale))))
    matrices = np.tile(np.eye(4), (count, 1, 1))
    matrices[:, :3, :3] = Rotation.from_quat(rotation).as_matrix() * np.asarray(scale)[:, None]
    matrices[:, :3, 3] = translation
    return matrices


def _from_glossy(factors: Tree, pictures: dict[str, Image]) -> Tree:
    """Factors and textures of the metallic and rough material of a glossy one, whose textures are taken out."""
    glossy = {key: pictures.pop(key) for key in ("diffuseTexture", "specularGlossinessTexture") if key in pictures}
    if not glossy:
        return specular_to_pbr(**factors)
    width, height = np.max([picture.size for picture in glossy.values()], axis=0).tolist()
    glossy = {key: picture.convert("RGBA").resize((width, height)) for key, picture in glossy.items()}
    strips = []
    for top in range(0, height, STRIP_ROWS):
        area = 0, top, width, min(top + STRIP_ROWS, height)
        strips.append(specular_to_pbr(**factors | {key: picture.crop(area) for key, picture in glossy.items()}))
    keys = [key for key, value in strips[0].items() if isinstance(value, Image)]
    return strips[0] | {key: fromarray(np.concatenate([strip[key] for strip in strips])) for key in keys}
