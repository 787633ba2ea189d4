"""glTF 2.0 (.gltf, .glb): what its default scene shows at rest, with morph targets at their default weights and skins.

Names and numbers of sections are those of the specification (Khronos, glTF 2.0). Materials become metallic and rough:

- metallic and roughness are the file's, else 1; a part without a material is not metal;
- unlit: metallic 0, roughness 1, the base colour alone;
- specular and glossiness: converted as Khronos' example does, by trimesh;
- transmission: blended, with an opacity of 1 less 0.9 of what is transmitted, so that what is behind it is seen;
- textures share the coordinates and the wrapping of the base colour's. One with other coordinates is left out.
"""

import base64
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import unquote_to_bytes

import numpy as np
import PIL.Image
import trimesh
from scipy.spatial.transform import Rotation
from trimesh.util import unique_name
from trimesh.visual.gloss import specular_to_pbr
from trimesh.visual.material import PBRMaterial

from palpate.mesh import part
from palpate.mesh.files import GREY, Files
from palpate.mesh.part import Loaded, make_part
from palpate.named_files import gltf_tree

COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}  # 3.6.2.2
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
CONVERT = "convert it, e.g. gltf-pipeline -i old.gltf -o new.gltf"
TRIANGLES, STRIP, FAN = 4, 5, 6  # modes of a primitive; 0 to 3 are points and lines (3.7.2.1)
WRAPS = {33071: "clamp", 33648: "mirror"}  # of a sampler; others repeat
ELEMENTS_A_BYTE = 100  # of the file, at most, of an accessor without data of its own: all zeros, or sparse
STRIP_ROWS = 256  # of a picture that are converted at once: a large one takes gigabytes as numbers
CLEAREST = 0.1  # opacity of a material that transmits all light
DRACO, MESHOPT = "KHR_draco_mesh_compression", ("EXT_meshopt_compression", "KHR_meshopt_compression")
REMEDIES = {
    DRACO: "import it into Blender, which reads it, and export it without compression",
    **dict.fromkeys(MESHOPT, "write it without, e.g. gltfpack -i in.glb -o out.glb -noq"),
}
# Those that are read, and those that change neither shape nor base colour, and are left out.
KNOWN = {
    *("KHR_mesh_quantization", "EXT_mesh_gpu_instancing", "KHR_node_visibility", "KHR_materials_variants"),
    *("KHR_texture_transform", "KHR_texture_basisu", "EXT_texture_webp", "EXT_texture_avif", "MSFT_texture_dds"),
    *("KHR_xmp_json_ld", "KHR_lights_punctual", "KHR_animation_pointer", "MSFT_lod", "EXT_lights_image_based"),
    *(f"KHR_materials_{name}" for name in ("unlit", "pbrSpecularGlossiness", "transmission", "emissive_strength")),
    *(f"KHR_materials_{name}" for name in ("clearcoat", "sheen", "specular", "ior", "volume", "iridescence")),
    *(f"KHR_materials_{name}" for name in ("anisotropy", "dispersion", "diffuse_transmission")),
}
Tree = dict[str, Any]


class Place(NamedTuple):
    """Where a texture lies on a part: number of the coordinates, their offset, rotation and scale, and its wrapping."""

    number: int = 0
    transform: tuple = ((0, 0), 0, (1, 1))
    wrap: tuple[str, str] | None = None


def read(path: Path, files: Files) -> Loaded:
    """Raises ValueError, LookupError or TypeError if the file is damaged, and ValueError if it needs what is not
    read."""
    return Loaded(_Document(path, files).parts())


class _Document:
    def __init__(self, path: Path, files: Files):
        self.files, data = files, path.read_bytes()
        binary = data[:4] == b"glTF"
        if binary != (path.suffix.lower() == ".glb"):
            raise ValueError(f"its content is {'.glb' if binary else 'no .glb'}: rename it, or it is damaged")
        if binary and (version := int.from_bytes(data[4:8], "little")) != 2:
            raise ValueError(f"it is glTF {version}, and 2.0 is read: {CONVERT}")
        self.tree, start = gltf_tree(path)
        version = self.tree.get("asset", {}).get("version", "without a version")
        if str(version).split(".")[0] != "2":
            raise ValueError(f"it is glTF {version}, and 2.0 is read: {CONVERT}")
        for name in self.tree.get("extensionsRequired", []):
            if name not in KNOWN:
                raise _not_read("it", name)
        chunk = None
        if binary and len(data) >= start:
            end = start + int.from_bytes(data[start - 8 : start - 4], "little")
            chunk = memoryview(data)[start:end]
        self.buffers = [self._buffer(*numbered, chunk) for numbered in enumerate(self.tree.get("buffers", []))]
        self.size = len(data) + sum(len(buffer) for buffer in self.buffers if buffer is not None)
        self.worlds = self._worlds()
        self.picture, self.material = cache(self._picture), cache(self._material)

    def _buffer(self, number: int, given: Tree, chunk: memoryview | None) -> bytes | memoryview | None:
        """A buffer's content; None if it is a place holder of compressed data."""
        if "uri" in given:
            data = self._named(given["uri"])
        else:
            fallback = any(given.get("extensions", {}).get(name, {}).get("fallback") for name in MESHOPT)
            data = None if number or fallback else chunk
        if data is not None and len(data) < given["byteLength"]:
            raise ValueError(f"cut off: buffer {number} says {given['byteLength']:,} bytes, and has {len(data):,}")
        return data

    def _named(self, uri: str) -> bytes:
        if uri[:5].lower() != "data:":
            return self.files.read(uri)
        head, _, body = uri.partition(",")
        data = unquote_to_bytes(body)
        return base64.b64decode(data) if head.endswith(";base64") else data

    def _view(self, number: int) -> memoryview:
        """The bytes of a buffer view. Raises ValueError if the file lacks them."""
        view = self.tree["bufferViews"][number]
        buffer, start, length = self.buffers[view["buffer"]], view.get("byteOffset", 0), view["byteLength"]
        if buffer is None:
            compressed = next((name for name in MESHOPT if name in view.get("extensions", {})), None)
            if compressed:
                raise _not_read(f"buffer view {number}", compressed)
            raise ValueError(f"buffer {view['buffer']} has no data")
        if not 0 <= start <= start + length <= len(buffer):
            raise ValueError(f"buffer view {number} has {length:,} bytes from {start:,}, of {len(buffer):,}: cut off")
        return memoryview(buffer)[start : start + length]

    def _elements(self, name: str, given: Tree, count: int, component: int, width: int) -> np.ndarray:
        """Elements (count, width) in a buffer view; given: an accessor, or indices or values of a sparse one."""
        data, dtype, start = (
            self._view(given["bufferView"]),
            np.dtype(COMPONENTS[component]),
            given.get("byteOffset", 0),
        )
        size = dtype.itemsize * width
        stride = self.tree["bufferViews"][given["bufferView"]].get("byteStride", size)
        if count < 0 or start < 0 or stride <= 0 or (count and start + (count - 1) * stride + size > len(data)):
            raise ValueError(f"{name} says {count:,} elements, and has {len(data):,} bytes at most: it is damaged")
        return np.ndarray((count, width), dtype, data, start if count else 0, (stride, dtype.itemsize))

    def accessor(self, number: int) -> np.ndarray:
        """Elements (count, width) of an accessor as they are stored."""
        given, name = self.tree["accessors"][number], f"accessor {number}"
        count, component, width = given["count"], given["componentType"], WIDTHS[given["type"]]
        if "bufferView" in given:
            values = self._elements(name, given, count, component, width)
        elif 0 <= count <= ELEMENTS_A_BYTE * self.size:
            values = np.zeros((count, width), COMPONENTS[component])
        else:
            raise ValueError(f"{name} says {count:,} elements, and the file has {self.size:,} bytes")
        if "sparse" in given:
            few, indices = given["sparse"], given["sparse"]["indices"]
            values = values.copy()
            places = self._elements(name, indices, few["count"], indices["componentType"], 1)[:, 0]
            values[places] = self._elements(name, few["values"], few["count"], component, width)
        return values

    def floats(self, number: int, normalise: bool = False) -> np.ndarray:
        """Elements of an accessor as numbers: integers in parts of their largest, if it says so, or if asked."""
        values = self.accessor(number)
        if values.dtype.kind != "f" and (normalise or self.tree["accessors"][number].get("normalized")):
            return np.maximum(values / np.iinfo(values.dtype).max, -1.0)
        return values

    def _worlds(self) -> list[np.ndarray]:
        """Matrices (4, 4) from each node to the file's frame."""
        nodes = self.tree.get("nodes", [])
        children = {child for node in nodes for child in node.get("children", [])}
        self.roots = [number for number in range(len(nodes)) if number not in children]
        worlds: dict[int, np.ndarray] = {}
        waiting = [(number, np.eye(4)) for number in self.roots]
        while waiting:
            number, above = waiting.pop()
            if number in worlds:
                raise ValueError(f"node {number} is a child of two nodes")
            worlds[number] = above @ _local(nodes[number])
            waiting += [(child, worlds[number]) for child in nodes[number].get("children", [])]
        if len(worlds) < len(nodes):
            lost = next(number for number in range(len(nodes)) if number not in worlds)
            raise ValueError(f"node {lost} is among its own children (a cycle)")
        return [worlds[number] for number in range(len(nodes))]

    def _shown(self) -> list[int]:
        """Numbers of the nodes of the default scene (else of the first, else of all), by their names."""
        nodes, scenes = self.tree.get("nodes", []), self.tree.get("scenes", [])
        waiting = scenes[self.tree.get("scene", 0)].get("nodes", []) if scenes else self.roots
        shown, names, counts = set(), {}, {}
        while waiting:
            visible = [
                number
                for number in waiting
                if number not in shown
                and nodes[number].get("extensions", {}).get("KHR_node_visibility", {}).get("visible", True)
            ]
            shown.update(visible)
            waiting = [child for number in visible for child in nodes[number].get("children", [])]
        for number, node in enumerate(nodes):
            names[unique_name(node.get("name", str(number)), names, counts)] = number
        return [names[name] for name in sorted(names) if names[name] in shown]

    def parts(self) -> list[trimesh.Trimesh]:
        meshes, names, counts = self.tree.get("meshes", []), {}, {}
        for number, mesh in enumerate(meshes):
            for place in range(len(mesh["primitives"])):
                names[unique_name(mesh.get("name", "GLTF"), names, counts)] = number, place
        named, parts = {place: name for name, place in names.items()}, []
        for number in self._shown():
            node = self.tree["nodes"][number]
            if "mesh" not in node:
                continue
            mesh = meshes[node["mesh"]]
            weights = node.get("weights", mesh.get("weights", []))
            for place, primitive in enumerate(mesh["primitives"]):
                parts += self._primitive(named[node["mesh"], place], primitive, weights, number)
        return parts

    def _primitive(self, name: str, primitive: Tree, weights: list[float], number: int) -> list[trimesh.Trimesh]:
        """The parts that a node makes of a primitive: one, or one an instance."""
        attributes, mode = primitive["attributes"], primitive.get("mode", TRIANGLES)
        numbers = [*attributes.values(), *([primitive["indices"]] if "indices" in primitive else [])]
        whole = all("bufferView" in self.tree["accessors"][each] for each in numbers)
        if DRACO in primitive.get("extensions", {}) and not whole:
            raise _not_read(f"mesh {name}", DRACO)
        if mode not in (TRIANGLES, STRIP, FAN) or "POSITION" not in attributes:
            self.files.note(name, "points or lines, which have no surface: left out")
            return []
        vertices = self._attribute(name, primitive, weights, "POSITION").astype(float)
        order = self.accessor(primitive["indices"])[:, 0] if "indices" in primitive else np.arange(len(vertices))
        faces = _triangles(name, mode, order)
        normals = self._attribute(name, primitive, weights, "NORMAL")
        colours = self._attribute(name, primitive, weights, "COLOR_0")
        material, where = None, None
        if "material" in primitive:
            sets = frozenset(key for key in attributes if key.startswith("TEXCOORD_"))
            material, where = self.material(primitive["material"], sets)
        if colours is not None:
            light = np.full((len(colours), 4), 255, np.uint8)
            light[:, : colours.shape[1]] = np.round(255 * np.clip(np.nan_to_num(colours), 0, 1))
            if material is None or material.alphaMode in (None, "OPAQUE"):
                light[:, 3] = 255
            colours = light
        uv = None if where is None else self._attribute(name, primitive, weights, f"TEXCOORD_{where.number}")
        if uv is not None:
            uv = _moved(uv, *where.transform)
        placed = []
        for matrix in self._placements(number, attributes, len(vertices)):
            linear = matrix[..., :3, :3]
            with np.errstate(invalid="ignore", over="ignore"):  # vertices that are not finite are looked for later
                points = np.einsum("...ij,...j->...i", linear, vertices) + matrix[..., :3, 3]
                if normals is not None:
                    turned = np.einsum("...ji,...j->...i", np.linalg.pinv(linear), normals)
            mirrored = np.median(np.linalg.det(linear)) < 0
            placed.append(
                make_part(
                    name, points, faces[:, ::-1] if mirrored else faces, material, uv=uv, colours=colours,
                    normals=None if normals is None else turned, wrap=where and where.wrap,
                )
            )  # fmt: skip
        return placed

    def _attribute(self, name: str, primitive: Tree, weights: list[float], key: str) -> np.ndarray | None:
        """An attribute's values with those of the morph targets added; None if the primitive has none."""
        if key not in primitive["attributes"]:
            return None
        colour = key.startswith("COLOR")
        values = self.floats(primitive["attributes"][key], colour)
        for weight, target in zip(weights, primitive.get("targets", []), strict=False):
            if weight and key in target:
                values = values.astype(float) + weight * self.floats(target[key], colour)
        count = self.tree["accessors"][primitive["attributes"]["POSITION"]]["count"]
        if len(values) != count:
            raise ValueError(f"mesh {name} has {len(values):,} elements of {key} for {count:,} positions")
        return values

    def _placements(self, number: int, attributes: Tree, count: int) -> list[np.ndarray]:
        """Matrices to the file's frame: one (4, 4), or one an instance, or one (count, 4, 4) of a skin's vertices."""
        node = self.tree["nodes"][number]
        if "skin" in node and "JOINTS_0" in attributes:  # the node's own transform is ignored (3.7.3.3)
            skin = self.tree["skins"][node["skin"]]
            joints = np.stack([self.worlds[joint] for joint in skin["joints"]])
            if "inverseBindMatrices" in skin:
                inverse = self.accessor(skin["inverseBindMatrices"])[: len(joints)]
                joints = joints @ inverse.reshape(-1, 4, 4).transpose(0, 2, 1)
            matrices, total, pair = np.zeros((count, 4, 4)), np.zeros((count, 1, 1)), 0
            while f"JOINTS_{pair}" in attributes:
                which, weights = self.accessor(attributes[f"JOINTS_{pair}"]), self.floats(attributes[f"WEIGHTS_{pair}"])
                for joint, weight in zip(which.T, weights.T.astype(float)[..., None, None], strict=True):
                    matrices += weight * joints[joint]
                    total += weight
                pair += 1
            return [np.where(total > 0, matrices / np.where(total > 0, total, 1), joints[0])]
        if instancing := node.get("extensions", {}).get("EXT_mesh_gpu_instancing"):
            moved = {key.lower(): self.floats(accessor) for key, accessor in instancing["attributes"].items()}
            return list(self.worlds[number] @ _matrices(moved))
        return [self.worlds[number]]

    def _material(self, number: int, sets: frozenset[str]) -> tuple[PBRMaterial, Place | None]:
        """A material, and where its textures lie; sets: names of the part's texture coordinates."""
        given = self.tree["materials"][number]
        name, extensions = given.get("name"), given.get("extensions", {})
        unlit, glossy = "KHR_materials_unlit" in extensions, extensions.get("KHR_materials_pbrSpecularGlossiness")
        base, shine, factors = "baseColorTexture", "metallicRoughnessTexture", given.get("pbrMetallicRoughness", {})
        if glossy is not None and not unlit:
            base, shine, factors = "diffuseTexture", "specularGlossinessTexture", glossy
        keys = (base,) if unlit else (base, shine, "normalTexture", "emissiveTexture", "occlusionTexture")
        infos = {key: info for key in keys if (info := factors.get(key, given.get(key)))}
        where = next((self._where(info) for info in infos.values()), Place())
        pictures = {key: self._usable(name or f"material {number}", key, infos[key], where, sets) for key in infos}
        if base in infos and pictures[base] is None:
            return part.plain(part.GREY, name), None
        lost = {key for key in infos if pictures[key] is None}
        made = {key: factors[key] for key in ("baseColorFactor", "metallicFactor", "roughnessFactor") if key in factors}
        if base == "diffuseTexture":
            factors = factors | ({"specularFactor": [0.04] * 3} if shine in lost else {})
            made = _from_glossy(factors, {key: pictures.pop(key) for key in (base, shine) if pictures.get(key)})
        made = {"baseColorFactor": [1.0] * 4, "metallicFactor": 1.0, "roughnessFactor": 1.0} | made | pictures
        if unlit or shine in lost:  # what the texture would say of metal is not known
            made |= {"metallicFactor": 0.0, "roughnessFactor": 1.0 if unlit else made["roughnessFactor"]}
        if "emissiveFactor" in given and not unlit and "emissiveTexture" not in lost:
            strength = extensions.get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1.0)
            made["emissiveFactor"] = strength * np.array(given["emissiveFactor"], dtype=float)
        made["baseColorFactor"] = np.array(made["baseColorFactor"], dtype=float)
        made |= {key: given[key] for key in ("alphaMode", "alphaCutoff", "doubleSided") if key in given}
        clear = extensions.get("KHR_materials_transmission", {})
        through = clear.get("transmissionFactor", 0.0) * (1 - (0 if shine in pictures else made["metallicFactor"]))
        if through > 0:
            if "transmissionTexture" in clear:
                self.files.note(
                    f"{name or f'material {number}'}, transmissionTexture", "left out: it is clear all over"
                )
            if made.get("alphaMode", "OPAQUE") == "OPAQUE":  # its alpha does not count
                made["baseColorFactor"][3] = 1.0
                if (picture := made.get("baseColorTexture")) is not None and picture.mode not in ("RGB", "L", "CMYK"):
                    made["baseColorTexture"] = picture.convert("RGB")
            made["baseColorFactor"][3] *= 1 - (1 - CLEAREST) * through
            made["alphaMode"] = "BLEND"
        return PBRMaterial(name=name, **made), where

    def _where(self, info: Tree) -> Place:
        moved, texture = (
            info.get("extensions", {}).get("KHR_texture_transform", {}),
            self.tree["textures"][info["index"]],
        )
        sampler = self.tree["samplers"][texture["sampler"]] if "sampler" in texture else {}
        wrap = WRAPS.get(sampler.get("wrapS"), "repeat"), WRAPS.get(sampler.get("wrapT"), "repeat")
        transform = tuple(moved.get("offset", (0, 0))), moved.get("rotation", 0), tuple(moved.get("scale", (1, 1)))
        number = moved.get("texCoord", info.get("texCoord", 0))
        return Place(number, transform, None if wrap == ("repeat", "repeat") else wrap)

    def _usable(self, label: str, key: str, info: Tree, where: Place, sets: frozenset[str]) -> PIL.Image.Image | None:
        """A material's picture; None, and a note, if it can't be used."""
        follows = GREY if key in ("baseColorTexture", "diffuseTexture") else "left out"
        if self._where(info)[:2] != where[:2]:
            if key != "occlusionTexture":  # which is not drawn anyway
                self.files.note(f"{label}, {key}", f"it has other coordinates than the base colour: {follows}")
        elif f"TEXCOORD_{where.number}" not in sets:
            self.files.note(f"{label}, {key}", f"a part has no coordinates for it: {follows}")
        else:
            return self.picture(info["index"], follows)
        return None

    def _picture(self, number: int, follows: str) -> PIL.Image.Image | None:
        texture = self.tree["textures"][number]
        others = (given["source"] for given in texture.get("extensions", {}).values() if "source" in given)
        source = texture.get("source", next(others, None))
        if source is None:
            self.files.note(f"texture {number}", f"it has no image: {follows}")
            return None
        image, data = self.tree["images"][source], None
        name = image.get("name") or f"image {source}"
        if "bufferView" in image:
            data = bytes(self._view(image["bufferView"]))
        elif image["uri"][:5].lower() == "data:":
            data = self._named(image["uri"])
        else:
            name = image["uri"]
        return self.files.picture(name, data, follows)


def _not_read(what: str, extension: str) -> ValueError:
    remedy = REMEDIES.get(extension, "export it without")
    return ValueError(f"{what} needs the extension {extension}, which is not read: {remedy}")


def _triangles(name: str, mode: int, order: np.ndarray) -> np.ndarray:
    """Faces (f, 3) of a primitive (3.7.2.1); order (n,): its vertices one after the other."""
    if mode == TRIANGLES:
        if len(order) % 3:
            raise ValueError(f"mesh {name} has {len(order):,} corners of triangles, which are no three each")
        return order.reshape(-1, 3)
    first = np.arange(max(len(order) - 2, 0))
    odd = first % 2
    return order[
        np.stack([first, first + 1 + odd, first + 2 - odd] if mode == STRIP else [first + 1, first + 2, 0 * odd], 1)
    ]


def _local(node: Tree) -> np.ndarray:
    """The matrix (4, 4) from a node to its parent."""
    if "matrix" in node:
        return np.reshape(node["matrix"], (4, 4)).T.astype(float)
    moved = {key: np.array([node[key]], dtype=float) for key in ("translation", "rotation", "scale") if key in node}
    return _matrices(moved)[0] if moved else np.eye(4)


def _matrices(moved: dict[str, np.ndarray]) -> np.ndarray:
    """Matrices (n, 4, 4) of translations (n, 3), rotations (n, 4) with w last, and scales (n, 3), those that are
    given."""
    matrices = np.tile(np.eye(4), (len(next(iter(moved.values()))), 1, 1))
    if "rotation" in moved:
        matrices[:, :3, :3] = Rotation.from_quat(moved["rotation"]).as_matrix()
    if "scale" in moved:
        matrices[:, :3, :3] *= moved["scale"][:, None]
    if "translation" in moved:
        matrices[:, :3, 3] = moved["translation"]
    return matrices


def _moved(uv: np.ndarray, offset: tuple, rotation: float, scale: tuple) -> np.ndarray:
    """Texture coordinates (n, 2), v upwards, after KHR_texture_transform; rotation: anticlockwise, as seen."""
    if (offset, rotation, scale) == Place().transform:
        uv = uv.copy()
    else:
        cos, sin = np.cos(rotation), np.sin(rotation)
        uv = uv * np.array(scale) @ np.array([[cos, -sin], [sin, cos]]) + np.array(offset)
    uv[:, 1] = 1.0 - uv[:, 1]
    return uv


def _from_glossy(factors: Tree, pictures: dict[str, PIL.Image.Image]) -> Tree:
    """The metallic and rough material of one of specular colour and glossiness, its pictures made in strips."""
    factors = {key: value for key, value in factors.items() if key.endswith("Factor")}
    if not pictures:
        return specular_to_pbr(**factors)
    size = tuple(max(picture.size[axis] for picture in pictures.values()) for axis in (0, 1))
    pictures = {key: picture.convert("RGBA").resize(size) for key, picture in pictures.items()}
    whole: Tree = {}
    for top in range(0, size[1], STRIP_ROWS):
        area = (0, top, size[0], min(top + STRIP_ROWS, size[1]))
        strip = specular_to_pbr(**factors, **{key: picture.crop(area) for key, picture in pictures.items()})
        for key, value in strip.items():
            if isinstance(value, PIL.Image.Image):
                whole.setdefault(key, PIL.Image.new(value.mode, size)).paste(value, area)
            else:
                whole[key] = value
    return whole
