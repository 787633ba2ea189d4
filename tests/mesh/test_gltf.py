"""glTF is read as its specification says: shapes beside Blender's own import, looks beside what they were made of."""

import base64
import io
import json
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from palpate import mesh
from palpate.batch import UnusableObject
from palpate.mesh import OBJECT_POSITION
from palpate.mesh.load import load
from palpate.mesh.part import GREY
from palpate.named_files import companions
from palpate.scene import Scene
from palpate.vision import Renderer, looking_at
from tests.mesh.reading import CASES, assert_same, by_blender, measured, triangles

BOX = trimesh.creation.box(bounds=[[0, 0, 0], [1, 1, 1]])
CORNERS, FACES = BOX.vertices.astype("<f4"), BOX.faces.astype("<u4")
PLATE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], "<f4")  # of two triangles, (0, 1, 2) and (0, 2, 3)
PLATE_UV = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], "<f4")  # upright: v is down in glTF
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
CODES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
RED, BLUE = (200, 10, 10), (10, 10, 200)
HALF = np.sqrt(0.5)


class Document:
    """A glTF file in the making: its JSON, and the data of its only buffer."""

    def __init__(self, **tree):
        self.tree = {"asset": {"version": "2.0"}, "accessors": [], "bufferViews": [], "meshes": [], "nodes": []} | tree
        self.data = b""

    def view(self, data: bytes, **more) -> int:
        self.data += bytes(-len(self.data) % 4)
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)} | more
        self.tree["bufferViews"].append(view)
        self.data += data
        return len(self.tree["bufferViews"]) - 1

    def add(self, values: np.ndarray, **more) -> int:
        """An accessor of values (n,) or (n, width)."""
        values = np.ascontiguousarray(values)
        width = 1 if values.ndim == 1 else values.shape[1]
        kind = {"componentType": CODES[values.dtype.str[1:]], "type": TYPES[width], "count": len(values)}
        self.tree["accessors"].append({"bufferView": self.view(values.tobytes())} | kind | more)
        return len(self.tree["accessors"]) - 1

    def primitive(self, vertices=CORNERS, faces=FACES, material=None, more=None, **attributes) -> dict:
        """Attributes are arrays, or accessors' numbers."""
        given = {"POSITION": vertices} | attributes
        numbers = {key: value if isinstance(value, int) else self.add(value) for key, value in given.items()}
        made = {"attributes": numbers} | (more or {})
        made |= {} if faces is None else {"indices": self.add(np.ravel(faces))}
        return made | ({} if material is None else {"material": material})

    def mesh(self, *primitives: dict, **more) -> int:
        self.tree["meshes"].append({"primitives": list(primitives)} | more)
        return len(self.tree["meshes"]) - 1

    def node(self, **node) -> int:
        self.tree["nodes"].append(node)
        return len(self.tree["nodes"]) - 1

    def picture(self, image, extension: str | None = None, sampler: dict | None = None, kind="png") -> int:
        """A texture of an image, or of bytes that may be none."""
        file = io.BytesIO(image if isinstance(image, bytes) else b"")
        if not isinstance(image, bytes):
            image.save(file, kind, **({"lossless": True} if kind == "webp" else {}))
        images, textures = self.tree.setdefault("images", []), self.tree.setdefault("textures", [])
        images.append({"bufferView": self.view(file.getvalue()), "mimeType": f"image/{kind}"})
        source = {"source": len(images) - 1}
        textures.append(source if extension is None else {"extensions": {extension: source}})
        if sampler:
            textures[-1]["sampler"] = len(self.tree.setdefault("samplers", []))
            self.tree["samplers"].append(sampler)
        return len(textures) - 1

    def write(self, path: Path) -> Path:
        tree = {key: value for key, value in self.tree.items() if value not in ([], None)}
        if not tree.get("nodes"):
            tree["nodes"] = [{"mesh": number} for number in range(len(self.tree["meshes"]))]
        buffer = {"byteLength": len(self.data)}
        tree["buffers"] = [buffer, *tree.get("buffers", [])]
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix == ".gltf":
            buffer["uri"] = "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
            path.write_text(json.dumps(tree))
        else:
            text, data = json.dumps(tree).encode(), self.data + bytes(-len(self.data) % 4)
            text += b" " * (-len(text) % 4)
            chunks = b"".join(len(part).to_bytes(4, "little") + name + part
                              for name, part in ((b"JSON", text), (b"BIN\0", data)))  # fmt: skip
            path.write_bytes(b"glTF" + (2).to_bytes(4, "little") + (12 + len(chunks)).to_bytes(4, "little") + chunks)
        return path


def halves(left=RED, right=BLUE, size=16) -> PIL.Image.Image:
    image = PIL.Image.new("RGB", (size, size), left)
    image.paste(right, (size // 2, 0, size, size))
    return image


def plate(material: dict | None = None, uv=PLATE_UV, **attributes) -> Document:
    """A plate, with a material 0 that has metallic 0 unless it says otherwise."""
    document = Document(materials=[{"pbrMetallicRoughness": {"metallicFactor": 0}} | (material or {})])
    given = {} if uv is None else {"TEXCOORD_0": uv}
    document.mesh(document.primitive(PLATE, np.array([0, 1, 2, 0, 2, 3], "<u2"), 0, **given, **attributes))
    return document


def textured(document: Document, number: int, **info) -> Document:
    document.tree["materials"][0].setdefault("pbrMetallicRoughness", {"metallicFactor": 0})
    document.tree["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": number} | info
    return document


def prepared(path: Path, folder: Path):
    """The record, the JSON of visual.glb, and its parts."""
    record = mesh.prepare(path, folder, collision_faces=100)
    data = (folder / "visual.glb").read_bytes()
    tree = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    return record, tree, list(trimesh.load_scene(folder / "visual.glb", process=False).geometry.values())


def seen(folder: Path, *points, samples=16) -> np.ndarray:
    """Colours (n, 3), 0 to 255, of points of an object as its camera from above sees them, in shares of its box."""
    low, high = np.array(json.loads((folder / "mesh.json").read_text())["visual.glb"]["bounding_box"])
    places = OBJECT_POSITION + low + np.array(points) * (high - low)
    camera = looking_at(OBJECT_POSITION, np.add(OBJECT_POSITION, (0, -1e-3, 1.2)), 128)
    image, _ = Renderer(samples=samples, device="cpu").render(Scene(folder, camera=camera))
    pixels = np.floor(camera.project(places)[0]).astype(int)
    return np.array([image.rgb[y - 1 : y + 2, x - 1 : x + 2].reshape(-1, 3).mean(axis=0) for x, y in pixels])


def is_red(colours) -> np.ndarray:
    return (colours[:, 0] > colours[:, 1:].max(axis=1) + 60) & (colours[:, 0] > 90)


def is_blue(colours) -> np.ndarray:
    return is_red(colours[:, ::-1])


# Shapes: each beside Blender's import of the same file.


def skin() -> Document:
    """Two joints, one of them bent, a child of a node that is moved; the node of the mesh is moved in vain."""
    document = Document()
    bend = Rotation.from_euler("z", 40, degrees=True).as_quat().tolist()
    weights = np.where(CORNERS[:, 1:2] > 0.5, [0, 200, 55, 0], [255, 0, 0, 0]).astype("<u1")
    joints = np.tile(np.array([0, 1, 0, 0], "<u1"), (8, 1))
    number = document.mesh(document.primitive(JOINTS_0=joints, WEIGHTS_0=document.add(weights, normalized=True)))
    inverse = np.tile(np.eye(4, dtype="<f4"), (2, 1, 1))
    inverse[1, 3, 1] = -0.5  # column-major: the second joint is 0.5 up at the bind pose
    document.tree["skins"] = [{"joints": [1, 2], "inverseBindMatrices": document.add(inverse.reshape(2, 16))}]
    document.node(translation=[3, 0, 0], scale=[1, 2, 1], children=[1])
    document.node(children=[2])
    document.node(translation=[0, 0.5, 0], rotation=bend)
    document.node(mesh=number, skin=0, translation=[100, 0, 0])
    return document


def morph(**where) -> Document:
    document, target = Document(), np.where(CORNERS[:, :1] > 0.5, [2, 0, 0.5], 0).astype("<f4")
    first, second = document.add(target), document.add(np.roll(target, 1, axis=1))
    targets = {"targets": [{"POSITION": first}, {"POSITION": second}]}
    number = document.mesh(document.primitive(more=targets), **where.get("mesh", {}))
    document.node(mesh=number, **where.get("node", {}))
    return document


def instances() -> Document:
    document = Document(extensionsUsed=["EXT_mesh_gpu_instancing"], extensionsRequired=["EXT_mesh_gpu_instancing"])
    turn = Rotation.from_euler("xyz", [[0, 0, 0], [30, 0, 60], [0, 45, 0]], degrees=True).as_quat()
    attributes = {
        "TRANSLATION": document.add(np.array([[0, 0, 0], [2, 1, 0], [0, 0, 3]], "<f4")),
        "ROTATION": document.add(np.round(32767 * turn).astype("<i2"), normalized=True),
        "SCALE": document.add(np.array([[1, 1, 1], [1, 2, 1], [0.5, 0.5, 0.5]], "<f4")),
    }
    number = document.mesh(document.primitive())
    document.node(
        mesh=number, translation=[1, 0, 0], scale=[2, 1, 1],
        extensions={"EXT_mesh_gpu_instancing": {"attributes": attributes}},
    )  # fmt: skip
    return document


def strip(indexed: bool) -> Document:
    """A bent band as a strip, and a disc as a fan."""
    document, ladder = Document(), np.array([[x, y, 0.1 * x * x] for x in range(5) for y in (0, 1)], "<f4")
    ring = np.linspace(0, 2 * np.pi, 9)
    disc = np.concatenate([[[0, 0, 0]], np.stack([np.cos(ring), np.sin(ring), 0 * ring], 1)]).astype("<f4") - [0, 3, 0]
    order = [np.arange(len(points)).astype("<u2") if indexed else None for points in (ladder, disc)]
    modes = [{"mode": 5}, {"mode": 6}]
    document.mesh(*(document.primitive(points.astype("<f4"), faces, more=more)
                    for points, faces, more in zip((ladder, disc), order, modes, strict=True)))  # fmt: skip
    return document


def interleaved() -> Document:
    """Positions, normals and colours side by side in one view, and a second accessor within it."""
    document = Document()
    rows = np.zeros(8, dtype=[("n", "<f4", 3), ("p", "<f4", 3), ("c", "u1", 4)])
    rows["p"], rows["n"], rows["c"] = CORNERS * [1, 2, 3], (0, 0, 1), (255, 0, 0, 255)
    view = document.view(rows.tobytes(), byteStride=28)
    for offset, code, kind in ((12, 5126, "VEC3"), (0, 5126, "VEC3"), (24, 5121, "VEC4")):
        accessor = {"bufferView": view, "byteOffset": offset, "componentType": code, "type": kind, "count": 8}
        document.tree["accessors"].append(accessor | ({"normalized": True} if code == 5121 else {}))
    document.mesh(document.primitive(0, NORMAL=1, COLOR_0=2))
    return document


def quantised(dtype: str, normalized: bool) -> Document:
    document = Document(extensionsUsed=["KHR_mesh_quantization"], extensionsRequired=["KHR_mesh_quantization"])
    largest = np.iinfo(dtype).max
    padded = np.zeros((8, 4), dtype)  # elements begin at multiples of 4 bytes
    padded[:, :3] = np.round(CORNERS * [1, 0.5, 0.25] * largest)
    view = document.view(padded.tobytes(), byteStride=4 * padded.itemsize)
    accessor = {"bufferView": view, "componentType": CODES[padded.dtype.str[1:]], "type": "VEC3", "count": 8}
    document.tree["accessors"].append(accessor | ({"normalized": True} if normalized else {}))
    number = document.mesh(document.primitive(0))
    document.node(mesh=number, scale=[1 if normalized else 1 / largest] * 3, translation=[1, 2, 3])
    return document


def sparse_over_nothing() -> Document:
    """An accessor without a view is zeros; the sparse values are all that it has."""
    document, few = Document(), np.arange(1, 8).astype("<u1")
    indices, values = document.view(few.tobytes()), document.view(CORNERS[1:].tobytes())
    sparse = {"count": 7, "indices": {"bufferView": indices, "componentType": 5121}, "values": {"bufferView": values}}
    document.tree["accessors"].append({"componentType": 5126, "type": "VEC3", "count": 8, "sparse": sparse})
    assert not CORNERS[0].any()
    document.mesh(document.primitive(0))
    return document


def nested() -> Document:
    """Below matrices and mirroring, in a scene that is the second, beside a node that it does not show."""
    document = Document(scenes=[{"nodes": [3]}, {"nodes": [0]}], scene=1)
    number = document.mesh(document.primitive())
    matrix = np.array([[0, -2, 0, 1], [1, 0, 0, 2], [0, 0, 3, 0], [0, 0, 0, 1.0]])
    document.node(matrix=matrix.T.ravel().tolist(), children=[1, 2])
    document.node(mesh=number, scale=[-1, 1, 1], rotation=[0, 0, HALF, HALF])
    document.node(mesh=number, translation=[0, 0, 2])
    document.node(mesh=number, translation=[50, 0, 0])
    return document


def animated() -> Document:
    """A skin whose joint turns, and a mesh that moves and morphs, from their first moment on; at rest they do not."""
    document = skin()
    targets = {"targets": [{"POSITION": document.add(CORNERS)}]}
    document.node(mesh=document.mesh(document.primitive(more=targets), weights=[0.5]), translation=[0, 5, 0])
    turn = Rotation.from_euler("x", 70, degrees=True).as_quat()
    time = document.add(np.array([0, 1], "<f4"), min=[0], max=[1])
    moves = [(2, "rotation", [turn, turn]), (4, "translation", [[9, 9, 9]] * 2), (4, "weights", [0.0, 0.0])]
    values = [document.add(np.array(value, "<f4")) for _, _, value in moves]
    document.tree["animations"] = [
        {
            "samplers": [{"input": time, "output": value} for value in values],
            "channels": [
                {"sampler": k, "target": {"node": node, "path": path}} for k, (node, path, _) in enumerate(moves)
            ],
        }
    ]
    return document


SHAPES = {
    "skin": skin,
    "animated": animated,
    "morph": lambda: morph(mesh={"weights": [0.5, 0]}),
    "morph-of-the-node": lambda: morph(mesh={"weights": [0.5, 0.5]}, node={"weights": [1, 0.25]}),
    "morph-at-rest": morph,
    "instances": instances,
    "strip": lambda: strip(False),
    "strip-indexed": lambda: strip(True),
    "interleaved": interleaved,
    "bytes": lambda: quantised("<i1", True),
    "shorts": lambda: quantised("<u2", True),
    "shorts-not-normalised": lambda: quantised("<i2", False),
    "sparse-over-nothing": sparse_over_nothing,
    "nested": nested,
    "unindexed": lambda: (made := Document()).mesh(made.primitive(CORNERS[FACES.ravel()], None)) or made,
}
SHAPED = ("fan", "morph-weights", "no-scene", "sparse", "texture-transform", "uv-normalised", "clamp", "transmission")


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Files by name, and what Blender's import makes of each."""
    folder = tmp_path_factory.mktemp("shapes")
    suffixes = dict(zip(SHAPES, (".gltf", ".glb") * len(SHAPES), strict=False))
    paths = {name: make().write(folder / f"{name}{suffixes[name]}") for name, make in SHAPES.items()}
    paths |= {name: next((CASES / f"gltf-{name}").glob("*.gltf")) for name in SHAPED}
    return dict(zip(paths, zip(paths.values(), by_blender(*paths.values()), strict=True), strict=True))


@pytest.mark.parametrize("name", [*SHAPES, *SHAPED])
def test_a_shape_is_that_of_blenders_import(written, name):
    path, expected = written[name]
    loaded, problems = load(path)
    assert_same(measured(triangles(loaded.parts)), expected, 1e-6)
    assert problems == {} and loaded.unit == 1


def test_shapes_that_are_known(written):
    """In closed form, so that the reader and Blender are not wrong together."""
    boxes = {"morph": [[0, 0, 0], [2, 1, 1.25]], "morph-of-the-node": [[0, 0, 0], [3.125, 1.5, 1.5]],
             "morph-at-rest": [[0, 0, 0], [1, 1, 1]], "interleaved": [[0, 0, 0], [1, 2, 3]],
             "bytes": [[1, 2, 3], [2, 2.5, 3.25]], "sparse": [[0, 0, 0], [3, 1, 1]],
             "morph-weights": [[0, 0, 0], [3, 1, 1]], "fan": [[-0.5, 0, 0], [1.5, 3.5, 1]]}  # fmt: skip
    for name, box in boxes.items():
        parts = load(written[name][0])[0].parts
        found = [np.min([part.bounds[0] for part in parts], axis=0), np.max([part.bounds[1] for part in parts], axis=0)]
        np.testing.assert_allclose(found, box, atol=0.005)  # a byte's last digit is 1 / 127
    assert [len(part.faces) for part in load(written["fan"][0])[0].parts] == [12, 8]
    assert len(load(written["instances"][0])[0].parts) == 3


def test_the_lowest_signed_number_is_minus_one(tmp_path):
    """-128 and -127 of a byte alike (3.6.2.2), so that a box of both is closed."""
    values = np.zeros((8, 4), "<i1")
    values[:, :3] = np.where(CORNERS > 0.5, 127, np.where(np.arange(8)[:, None] % 2, -127, -128))
    document = Document(extensionsRequired=["KHR_mesh_quantization"])
    accessor = {"bufferView": document.view(values.tobytes(), byteStride=4), "componentType": 5120, "type": "VEC3"}
    document.tree["accessors"].append(accessor | {"count": 8, "normalized": True})
    document.mesh(document.primitive(0))
    (part,) = load(document.write(tmp_path / "a.glb"))[0].parts
    assert set(np.unique(part.vertices)) == {-1.0, 1.0} and part.volume == pytest.approx(8)


def test_normals_follow_morphs_skins_and_mirroring(tmp_path):
    """The normals of a face that is turned by 90 degrees, by each of three means."""
    up, side = np.tile(np.array([0, 0, 1], "<f4"), (4, 1)), np.tile(np.array([1, 0, 0], "<f4"), (4, 1))
    turn = Rotation.from_euler("y", 90, degrees=True)
    turned = (turn.apply(PLATE) - PLATE).astype("<f4")
    document = Document()
    target = {"POSITION": document.add(turned), "NORMAL": document.add(side - up)}
    faces = np.array([0, 1, 2, 0, 2, 3], "<u1")
    document.mesh(document.primitive(PLATE, faces, NORMAL=up, more={"targets": [target]}), weights=[1])
    skinned = document.primitive(
        PLATE, faces, NORMAL=up, JOINTS_0=np.zeros((4, 4), "<u2"), WEIGHTS_0=np.tile(np.eye(1, 4, dtype="<f4"), (4, 1))
    )
    document.mesh(skinned)
    document.mesh(document.primitive(PLATE, faces, NORMAL=up))
    document.tree["skins"] = [{"joints": [3]}]
    quaternion = turn.as_quat().tolist()
    document.tree["nodes"] = [{"mesh": 0, "name": "a"}, {"mesh": 1, "skin": 0, "name": "b"},
                              {"mesh": 2, "name": "c", "rotation": quaternion, "scale": [1, -2, 1]},
                              {"rotation": quaternion}]  # fmt: skip
    parts = load(document.write(tmp_path / "a.glb"))[0].parts
    assert len(parts) == 3
    for part in parts:
        given = part.metadata["vertex_normals"]
        np.testing.assert_allclose(given / np.linalg.norm(given, axis=1, keepdims=True), side, atol=1e-6)
        np.testing.assert_allclose(part.face_normals, side[:2], atol=1e-6)


def test_hidden_nodes_and_points_and_lines_are_left_out(tmp_path):
    document = Document(extensionsUsed=["KHR_node_visibility"])
    line = document.primitive(PLATE, np.array([0, 1], "<u1"), more={"mode": 1})
    document.node(mesh=document.mesh(document.primitive(), line, name="box"))
    document.node(children=[2], extensions={"KHR_node_visibility": {"visible": False}})
    document.node(mesh=0, translation=[9, 0, 0])
    loaded, problems = load(document.write(tmp_path / "a.gltf"))
    assert len(loaded.parts) == 1 and list(problems) == ["box_1"] and "no surface" in problems["box_1"]
    document.tree["meshes"][0]["primitives"] = [line]
    with pytest.raises(UnusableObject, match="points or lines only"):
        load(document.write(tmp_path / "b.gltf"))


# Looks: what is seen of visual.glb, or what it says.


@pytest.mark.parametrize(
    ("name", "left"), [("clamp", "red"), ("texture-transform", "blue"), ("uv-normalised", "red"), ("ktx2", None)]
)
def test_the_halves_of_the_plates(tmp_path, name, left):
    record, tree, _ = prepared(next((CASES / f"gltf-{name}").glob("*.gltf")), tmp_path)
    points = [(x, y, 1) for x in (0.08, 0.25, 0.42, 0.58, 0.75, 0.92) for y in (0.1, 0.5, 0.9)]
    colours = seen(tmp_path, *points)
    if left is None:
        assert np.ptp(colours, axis=1).max() < 12 and 60 < colours.mean() < 220
        assert list(record["source"]["problems"]) == ["wood.ktx2"]
        assert tree["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"][:3] == pytest.approx(
            [GREY] * 3, abs=0.01
        )
    else:
        assert is_red(colours).tolist() == [left == "red"] * 9 + [left != "red"] * 9
        assert is_blue(colours).tolist() == [left != "red"] * 9 + [left == "red"] * 9
        assert record["source"]["problems"] == {}


def test_unlit_and_coloured_boxes_are_red(tmp_path):
    for name in ("unlit", "colour-vec3-material"):
        record, tree, (part,) = prepared(next((CASES / f"gltf-{name}").glob("*.gltf")), tmp_path / name)
        assert is_red(seen(tmp_path / name, (0.3, 0.3, 1), (0.7, 0.6, 1))).all()
        assert tree["materials"][0]["pbrMetallicRoughness"]["metallicFactor"] == 0
        accessors = [tree["accessors"][number] for number in tree["meshes"][0]["primitives"][0]["attributes"].values()]
        assert len({accessor["count"] for accessor in accessors}) == 1
    assert np.unique(part.visual.vertex_attributes["color"], axis=0).tolist() == [[153, 5, 5, 255]]  # 0.6, 0.02, 0.02


def test_what_is_within_clear_glass_is_seen(tmp_path):
    record, tree, _ = prepared(CASES / "gltf-transmission/glass.gltf", tmp_path)
    colours = seen(tmp_path, (0.5, 0.5, 1), (0.1, 0.1, 1), samples=64)
    assert is_red(colours).tolist() == [True, False] and record["visual.glb"]["see_through"]


@pytest.mark.parametrize(
    ("material", "opacity"),
    [
        ({"extensions": {"KHR_materials_transmission": {"transmissionFactor": 1}}}, 0.1),
        ({"extensions": {"KHR_materials_transmission": {"transmissionFactor": 0.5}}}, 0.55),
        # A metal transmits nothing; the alpha of an opaque material does not count, and that of a blended one does.
        ({"pbrMetallicRoughness": {}, "extensions": {"KHR_materials_transmission": {"transmissionFactor": 1}}}, None),
        (
            {
                "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.5], "metallicFactor": 0},
                "extensions": {"KHR_materials_transmission": {"transmissionFactor": 1}},
                "alphaMode": "BLEND",
            },
            0.05,
        ),
        ({"extensions": {"KHR_materials_transmission": {}}}, None),
    ],
)
def test_transmission_is_opacity(tmp_path, material, opacity):
    record, tree, _ = prepared(plate(material).write(tmp_path / "a.glb"), tmp_path / "out")
    (material,) = tree["materials"]
    assert record["visual.glb"]["see_through"] == (opacity is not None) == ("alphaMode" in material)
    alpha = material["pbrMetallicRoughness"]["baseColorFactor"][3]
    assert alpha == pytest.approx(1 if opacity is None else opacity, abs=0.004)


def test_the_second_coordinates_and_a_rotated_texture(tmp_path):
    """The plate's texture turned by 90 degrees anticlockwise, as seen, about the middle: left is at the bottom."""
    document = plate(uv=None, TEXCOORD_0=0 * PLATE_UV, TEXCOORD_1=PLATE_UV)
    info = {"offset": [0, 1], "rotation": np.pi / 2}
    textured(
        document, document.picture(halves()), texCoord=0, extensions={"KHR_texture_transform": info | {"texCoord": 1}}
    )
    prepared(document.write(tmp_path / "a.gltf"), tmp_path / "out")
    colours = seen(tmp_path / "out", (0.25, 0.25, 1), (0.75, 0.25, 1), (0.25, 0.75, 1), (0.75, 0.75, 1))
    # Khronos: u' = cos u + sin v + offset, v' = cos v - sin u + offset; so u' is v, and v is 0 at the top.
    assert (
        is_red(colours).tolist() == [False, False, True, True] and is_blue(colours).tolist() == [True] * 2 + [False] * 2
    )


def test_coordinates_in_whole_numbers_are_scaled_by_the_transform(tmp_path):
    """As gltfpack writes them: 0 to 4095, not normalised."""
    document = plate(uv=None, TEXCOORD_0=(4095 * PLATE_UV).astype("<u2"))
    transform = {"KHR_texture_transform": {"scale": [1 / 4095, 0.5 / 4095], "offset": [0, 0.25]}}
    textured(document, document.picture(halves()), extensions=transform)
    (part,) = load(document.write(tmp_path / "a.glb"))[0].parts
    np.testing.assert_allclose(part.visual.uv, np.stack([PLATE_UV[:, 0], 0.75 - PLATE_UV[:, 1] / 2], 1), atol=1e-6)


def test_a_mirrored_texture_and_a_clamped_one_of_the_same_image(tmp_path):
    """Three plates in a row whose coordinates go to 2: repeated, mirrored, clamped; none has another's wrapping."""
    document = Document(materials=[{"pbrMetallicRoughness": {"metallicFactor": 0}} for _ in range(3)])
    modes = [None, {"wrapS": 33648, "wrapT": 33648}, {"wrapS": 33071}]
    for number, sampler in enumerate(modes):
        texture = document.picture(halves(), sampler=sampler)
        document.tree["materials"][number]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": texture}
        faces = np.array([0, 1, 2, 0, 2, 3], "<u1")
        uv = (PLATE_UV * [2, 1]).astype("<f4")
        document.node(mesh=document.mesh(document.primitive(PLATE, faces, number, TEXCOORD_0=uv)),
                      translation=[number, 0, 0])  # fmt: skip
    _, tree, _ = prepared(document.write(tmp_path / "a.glb"), tmp_path / "out")
    colours = seen(
        tmp_path / "out", *(((number + x) / 3, 0.5, 1) for number in range(3) for x in (0.12, 0.38, 0.62, 0.88))
    )
    red, blue = True, False
    assert is_red(colours).tolist() == [red, blue, red, blue, red, blue, blue, red, red, blue, blue, blue]
    assert (is_red(colours) ^ is_blue(colours)).all()
    assert tree["samplers"] == [{"wrapS": 33648, "wrapT": 33648}, {"wrapS": 33071, "wrapT": 10497}]
    assert len(tree["materials"]) == 3 and all("wrap" not in each.get("extras", {}) for each in tree["meshes"])


def test_webp_and_a_fallback_of_ktx2(tmp_path):
    webp = plate()
    textured(webp, webp.picture(halves(), "EXT_texture_webp", kind="webp")).tree["extensionsRequired"] = [
        "EXT_texture_webp"
    ]
    basis = plate()
    number = basis.picture(halves())
    basis.tree["textures"][number]["extensions"] = {"KHR_texture_basisu": {"source": 7}}
    for document in (webp, textured(basis, number)):
        record, _, (part,) = prepared(document.write(tmp_path / "a.glb"), tmp_path / "out")
        pixels = np.asarray(part.visual.material.baseColorTexture.convert("RGB"))
        assert np.abs(pixels[8, [2, 13]].astype(int) - [RED, BLUE]).max() <= 2 and record["source"]["problems"] == {}


def test_specular_and_glossiness(tmp_path):
    """Gold has its colour as specular; plastic has it as diffuse, with 4 %; a texture in strips is as one in one."""
    name = "KHR_materials_pbrSpecularGlossiness"
    gold = {"diffuseFactor": [0, 0, 0, 1], "specularFactor": [1, 0.76, 0.33], "glossinessFactor": 0.75}
    plastic = {"diffuseFactor": [0.5, 0.1, 0.1, 1], "specularFactor": [0.04, 0.04, 0.04], "glossinessFactor": 0.25}
    expected = [([1, 0.76, 0.33], 1, 0.25), ([0.5, 0.1, 0.1], 0, 0.75)]
    for given, (colour, metal, rough) in zip((gold, plastic), expected, strict=True):
        document = plate({"pbrMetallicRoughness": {}, "extensions": {name: given}})
        _, tree, _ = prepared(document.write(tmp_path / "a.gltf"), tmp_path / "out")
        made = tree["materials"][0]["pbrMetallicRoughness"]
        np.testing.assert_allclose(made["baseColorFactor"][:3], colour, atol=0.02)
        assert (made["metallicFactor"], made["roughnessFactor"]) == pytest.approx((metal, rough), abs=0.02)
    document = plate()
    picture = PIL.Image.fromarray(np.random.default_rng(0).integers(0, 256, (600, 8, 3), dtype=np.uint8))
    info = {"diffuseTexture": {"index": document.picture(picture)}, "specularFactor": [0, 0, 0], "glossinessFactor": 0}
    document.tree["materials"][0]["extensions"] = {name: info}
    _, _, (part,) = prepared(document.write(tmp_path / "a.glb"), tmp_path / "out")
    made = np.asarray(part.visual.material.baseColorTexture.convert("RGB")).astype(int)
    lighter = np.clip((np.asarray(picture) / 255) / 0.96 ** (1 / 2.2) * 255, 0, 255)  # by 1 / 0.96 in linear light
    assert np.abs(made - lighter).max() < 4


@pytest.mark.parametrize("dtype", ["<f4", "<u2", "<u1"])
@pytest.mark.parametrize("width", [3, 4])
@pytest.mark.parametrize("with_material", [False, True])
def test_colours_of_vertices(tmp_path, dtype, width, with_material):
    """Linear light; without a material, not of metal; alpha counts where the material blends, and only there."""
    largest = 1 if dtype == "<f4" else np.iinfo(dtype).max
    values = (np.tile([1, 0.5, 0, 0.5][:width], (4, 1)) * largest).astype(dtype)
    for mode in ("OPAQUE", "BLEND") if with_material else ("OPAQUE",):
        document = plate({"alphaMode": mode}, None)
        primitive = document.tree["meshes"][0]["primitives"][0]
        primitive["attributes"]["COLOR_0"] = document.add(values, **({} if dtype == "<f4" else {"normalized": True}))
        if not with_material:
            del primitive["material"]
        _, tree, (part,) = prepared(document.write(tmp_path / "a.glb"), tmp_path / "out")
        alpha = 128 if width == 4 and mode == "BLEND" else 255
        made = np.unique(part.visual.vertex_attributes["color"], axis=0)
        assert np.abs(made.astype(int) - [[255, 128, 0, alpha]]).max() <= 1
        assert tree["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] == [1, 1, 1, 1]
        assert tree["materials"][0]["pbrMetallicRoughness"]["metallicFactor"] == 0


def test_materials_of_metal_and_of_light(tmp_path):
    """Metallic is 1 where a material omits it, 0 without a material; light above 1 is written as its extension."""
    strong = {"KHR_materials_emissive_strength": {"emissiveStrength": 5}}
    lamp = plate({"pbrMetallicRoughness": {}, "emissiveFactor": [1, 0.5, 0], "extensions": strong})
    _, tree, _ = prepared(lamp.write(tmp_path / "a.glb"), tmp_path / "out")
    (material,) = tree["materials"]
    assert material["pbrMetallicRoughness"]["metallicFactor"] == 1
    assert material["emissiveFactor"] == [1, 0.5, 0] and material["extensions"] == strong
    assert tree["extensionsUsed"] == list(strong)
    document = Document()
    document.mesh(document.primitive())
    _, tree, _ = prepared(document.write(tmp_path / "a.glb"), tmp_path / "out")
    made = tree["materials"][0]["pbrMetallicRoughness"]
    assert made["metallicFactor"] == 0 and made["baseColorFactor"][:3] == pytest.approx([0.8] * 3, abs=0.002)


def test_textures_that_cannot_be_used_are_named(tmp_path):
    """Without its texture, a part is not of metal, and does not glow; without that of its colour, it is grey."""
    broken = b"no picture"
    document = plate({"name": "skin", "pbrMetallicRoughness": {}, "emissiveFactor": [1, 1, 1]})
    material = document.tree["materials"][0]
    textured(document, document.picture(halves()))
    material["pbrMetallicRoughness"]["metallicRoughnessTexture"] = {"index": document.picture(broken)}
    material["emissiveTexture"] = {"index": document.picture(broken)}
    moved = {"extensions": {"KHR_texture_transform": {"scale": [2, 2]}}}
    material["normalTexture"] = {"index": document.picture(halves())} | moved
    record, tree, _ = prepared(document.write(tmp_path / "a.glb"), tmp_path / "out")
    (made,) = tree["materials"]
    assert made["pbrMetallicRoughness"]["metallicFactor"] == 0 and "baseColorTexture" in made["pbrMetallicRoughness"]
    assert not any(made.get("emissiveFactor", [0])) and "normalTexture" not in made
    problems = record["source"]["problems"]
    assert set(problems) == {"image 1", "image 2", "skin, normalTexture"}
    assert all(problem.endswith("left out") for problem in problems.values())
    for change in ({"texCoord": 1}, {"index": 1}):
        material["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0} | change
        record, tree, _ = prepared(document.write(tmp_path / "a.glb"), tmp_path / "out")
        made = tree["materials"][0]["pbrMetallicRoughness"]
        assert made["baseColorFactor"] == pytest.approx([GREY] * 3 + [1], abs=0.01) and made["metallicFactor"] == 0
        assert any(problem.endswith("drawn in neutral grey") for problem in record["source"]["problems"].values())


# What is not read is an error that says what, and what to do.


def compressed(view: dict, buffers: list, **tree) -> Document:
    """A box whose positions are in a view of a second buffer, which stands for compressed data."""
    document = Document(buffers=buffers, extensionsUsed=["EXT_meshopt_compression"], **tree)
    document.mesh(document.primitive())
    extension = {"EXT_meshopt_compression": {"buffer": 0, "byteLength": 9, "byteStride": 12, "count": 8,
                                             "mode": "ATTRIBUTES"}}  # fmt: skip
    document.tree["bufferViews"][0] |= {"extensions": extension} | view
    return document


def uri(data: bytes) -> str:
    return "data:application/octet-stream;base64," + base64.b64encode(data).decode()


FALLBACK = {"byteLength": 96, "extensions": {"EXT_meshopt_compression": {"fallback": True}}}
SECOND = {"buffer": 1, "byteOffset": 0, "byteLength": 96}


def draco(**accessor) -> Document:
    document = Document(extensionsUsed=["KHR_draco_mesh_compression"])
    extension = {"bufferView": 0, "attributes": {"POSITION": 0}}
    document.mesh(document.primitive(more={"extensions": {"KHR_draco_mesh_compression": extension}}))
    document.tree["accessors"][0] |= accessor
    if accessor:
        del document.tree["accessors"][0]["bufferView"]
    return document


def changed(document: Document, **tree) -> Document:
    document.tree |= tree
    return document


def box() -> Document:
    document = Document()
    document.mesh(document.primitive())
    return document


def cut_view() -> Document:
    document = box()
    document.tree["bufferViews"][0]["byteLength"] = 90
    return document


REFUSED = {
    "draco": (lambda: draco(count=8), "KHR_draco_mesh_compression.*Blender"),
    "meshopt": (lambda: compressed(SECOND, [FALLBACK]), "EXT_meshopt_compression.*gltfpack"),
    "meshopt that is required": (
        lambda: compressed({}, [], extensionsRequired=["EXT_meshopt_compression"]), "EXT_meshopt_compression"
    ),
    "an unknown extension": (lambda: changed(box(), extensionsRequired=["ACME_gizmo"]), "ACME_gizmo"),
    "glTF 1.0": (lambda: changed(box(), asset={"version": "1.0"}), "glTF 1.0, not 2.0.*gltf-pipeline"),
    "no version": (lambda: changed(box(), asset={}), "of no version"),
    "a cycle": (lambda: changed(box(), nodes=[{"mesh": 0}, {"children": [2]}, {"children": [1]}]), "a cycle"),
    "two parents": (
        lambda: changed(box(), nodes=[{"children": [2]}, {"children": [2]}, {"mesh": 0}]), "child of two nodes"
    ),
    "a view that is too short": (cut_view, "cut off: 8 elements in a buffer view of 90 bytes"),
    "no whole triangles": (
        lambda: (made := Document()).mesh(made.primitive(faces=np.arange(7).astype("<u1"))) or made, "multiple of 3"
    ),
    "too few normals": (
        lambda: (made := Document()).mesh(made.primitive(NORMAL=CORNERS[:3])) or made, "3 elements of NORMAL"
    ),
    "a sparse index that is too high": (
        lambda: changed(d := sparse_over_nothing(), accessors=[d.tree["accessors"][0] | {"count": 4},
                                                               d.tree["accessors"][1]]), "out of bounds"
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
@pytest.mark.parametrize("suffix", [".gltf", ".glb"])
def test_what_is_not_read_is_named(tmp_path, name, suffix):
    make, reason = REFUSED[name]
    with pytest.raises(UnusableObject, match=reason):
        load(make().write(tmp_path / f"a{suffix}"))


@pytest.mark.parametrize(("name", "reason"), [("draco", "KHR_draco"), ("draco-part", "KHR_draco"), ("one", "glTF 1.0")])
def test_cases_that_are_refused(tmp_path, name, reason):
    with pytest.raises(UnusableObject, match=reason):
        mesh.prepare(next((CASES / f"gltf-{name}").glob("*.gltf")), tmp_path)


def test_what_has_a_fallback_is_read(tmp_path):
    """Draco and meshopt beside plain data: the plain ones are used."""
    plain = FALLBACK | {"uri": uri(CORNERS.tobytes())}
    for document in (draco(), compressed(SECOND, [plain]), compressed({}, [])):
        (part,) = load(document.write(tmp_path / "a.gltf"))[0].parts
        assert part.volume == pytest.approx(1)


def test_containers_that_are_damaged_or_misnamed(tmp_path):
    whole = box().write(tmp_path / "a.glb").read_bytes()
    for data, reason in ((whole[:-50], "cut off"), (whole[:100], "can't be read"), (whole[:8], "can't be read"),
                         (whole[:4] + b"\1" + whole[5:].replace(b'"2.0"', b'"1.0"'), "glTF 1.0, not 2.0"),
                         (b"{}", "can't be read")):  # fmt: skip
        (tmp_path / "b.glb").write_bytes(data)
        with pytest.raises(UnusableObject, match=reason):
            load(tmp_path / "b.glb")
    (tmp_path / "b.gltf").write_bytes(whole)
    with pytest.raises(UnusableObject, match="GLB by its content: rename it to .glb"):
        load(tmp_path / "b.gltf")


def test_named_buffers_and_pictures(tmp_path):
    """With percent encodings, escapes and characters of two code units, in a folder below."""
    document = plate()
    textured(document, document.picture(halves()))
    path = document.write(tmp_path / "a.gltf")
    tree = json.loads(path.read_text())
    (tmp_path / "data").mkdir()
    (tmp_path / "data/a b.bin").write_bytes(document.data)
    halves().save(tmp_path / "data/🎨.png")
    tree["buffers"][0]["uri"] = "data/a%20b.bin"
    tree["images"] = [{"uri": "data/🎨.png"}]
    path.write_text(json.dumps(tree).replace("/", "\\/"))
    loaded, problems = load(path)
    assert problems == {} and loaded.parts[0].visual.material.baseColorTexture.size == (16, 16)
    assert companions(path) == ["data/a b.bin", "data/🎨.png"]
    (tmp_path / "data/🎨.png").unlink()
    assert list(load(path)[1]) == ["data/🎨.png"]
    (tmp_path / "data/a b.bin").unlink()
    with pytest.raises(UnusableObject, match="data/a%20b.bin: there is no such file"):
        load(path)
