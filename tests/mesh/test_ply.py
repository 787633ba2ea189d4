"""PLY in the forms that others write, against what the file was made of, and beside Blender's import."""

import itertools
import struct

import numpy as np
import PIL.Image
import pytest
from trimesh.visual.color import srgb_to_linear

from palpate.batch import UnusableObject
from palpate.mesh.formats import ply
from palpate.mesh.load import load
from palpate.mesh.part import GREY, Files
from tests.mesh.reading import CASES, CORNERS, SIDES, assert_same, by_blender, measured, triangles

CODES = {"char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I", "float": "f", "double": "d",
         "int16": "h", "uint8": "B", "float64": "d"}  # fmt: skip
FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
COLOURS = np.random.default_rng(0).integers(2, 255, (8, 3))
XYZ = [("float", axis, column) for axis, column in zip("xyz", CORNERS.T, strict=True)]
FACES = [("list uchar int", "vertex_indices", SIDES)]


def write(path, kind="ascii", vertex=XYZ, face=FACES, before=(), after=(), comments=(), end="\n"):
    """A PLY whose elements have properties (type, name, values)."""
    elements = [*before, ("vertex", vertex), ("face", face), *after]
    lines = ["ply", f"format {kind} 1.0", *(f"comment {comment}" for comment in comments)]
    body = []
    for name, properties in elements:
        lines.append(f"element {name} {len(properties[0][2])}")
        lines += [f"property {kind_of} {key}" for kind_of, key, _ in properties]
        for row in zip(*(values for *_, values in properties), strict=True):
            body.append([])
            for (kind_of, *_), value in zip(properties, row, strict=True):
                *length, item = kind_of.removeprefix("list ").split()
                items = [(item, number) for number in (value if length else [value])]
                body[-1] += ([(length[0], len(value))] if length else []) + items
    head = end.join([*lines, "end_header", ""]).encode()
    if kind == "ascii":
        rows = end.join(" ".join(f"{number:.9g}" for _, number in row) for row in body) + end
        path.write_bytes(head + rows.encode())
    else:
        order = FORMATS[kind]
        whole = {"f", "d"}
        data = [
            struct.pack(order + CODES[item], number if CODES[item] in whole else int(number))
            for item, number in itertools.chain(*body)
        ]
        path.write_bytes(head + b"".join(data))
    return path


def is_box(part):
    found = measured(part.vertices[part.faces])
    return len(part.faces) == 12 and found["volume"] == pytest.approx(1) and found["area"] == pytest.approx(6)


def light(colours):
    return np.round(255 * srgb_to_linear(np.asarray(colours).astype(np.uint8)))


@pytest.mark.parametrize("name", ["binary-mixed/box_big", "binary-mixed/box_little", "diffuse/box", "tristrips/box"])
def test_cases_are_boxes(name):
    (part,) = load(CASES / f"ply-{name}.ply")[0].parts
    assert is_box(part) and (part.merge_vertices() or part.is_watertight)
    if "diffuse" in name:
        assert (part.visual.vertex_attributes["color"] == [*light([[200, 30, 30]])[0], 255]).all()


def test_a_concave_polygon():
    found = measured(triangles(load(CASES / "concave-polygon/u_profile.ply")[0].parts))
    assert (found["area"], found["volume"]) == (pytest.approx(30), pytest.approx(7))


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize(
    ("length", "index", "name"),
    [("uchar", "int", "vertex_indices"), ("int", "uint", "vertex_index"), ("uint8", "uchar", "vertex_indices"),
     ("ushort", "int16", "vertex_index")],
)  # fmt: skip
def test_orders_types_and_elements_that_are_not_read(tmp_path, kind, end, length, index, name):
    faces = [("uchar", "flags", range(6)), (f"list {length} {index}", name, SIDES), ("double", "quality", range(6))]
    vertex = [("uchar", "flag", range(8)), *(("float64", key, values) for _, key, values in XYZ[::-1]),
              ("list uchar float", "weights", [[1.5] * (row % 3) for row in range(8)])]  # fmt: skip
    other = ("material", [("short", "a", [1, -2]), ("list uchar double", "b", [[1, 2], []])])
    path = write(tmp_path / "a.ply", kind, vertex, faces, [other], [other], end=end)
    (part,) = load(path)[0].parts
    assert is_box(part)
    np.testing.assert_array_equal(part.vertices, CORNERS)


def channels(kind, values, names=("red", "green", "blue")):
    return [(kind, name, column) for name, column in zip(names, values.T, strict=True)]


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize(
    ("item", "factor", "names"),
    [("uchar", 1, ("red", "green", "blue")), ("uint8", 1, ("diffuse_red", "diffuse_green", "diffuse_blue")),
     ("ushort", 257, ("red", "green", "blue")), ("float", 1 / 255, ("red", "green", "blue")),
     ("double", 1 / 255, ("r", "g", "b")), ("int", 1, ("red", "green", "blue")),
     ("float", 1, ("red", "green", "blue"))],
)  # fmt: skip
@pytest.mark.parametrize("by", ["vertex", "face"])
def test_colours_are_srgb_of_any_type(tmp_path, kind, item, factor, names, by):
    of_vertex = [*XYZ, *channels(item, COLOURS * factor, names)] if by == "vertex" else XYZ
    of_face = [*FACES, *channels(item, COLOURS[:6] * factor, names)] if by == "face" else FACES
    (part,) = load(write(tmp_path / "a.ply", kind, of_vertex, of_face))[0].parts
    assert is_box(part)
    colours = part.visual.vertex_attributes["color"][:, :3]
    if by == "vertex":
        np.testing.assert_allclose(colours, light(COLOURS), atol=1)
    else:
        expected = np.repeat(light(COLOURS[:6]), 2, axis=0)[:, None].repeat(3, axis=1)
        np.testing.assert_allclose(colours[part.faces], expected, atol=1)
    assert tuple(part.visual.material.baseColorFactor[:3]) == (255, 255, 255)


def test_normals_are_kept_and_those_without_direction_are_not(tmp_path):
    normals = CORNERS - 0.5
    for factor, kept in ((1, True), (0, False), (np.nan, False)):
        vertex = [*XYZ, *channels("float", normals * factor, ("nx", "ny", "nz"))]
        (part,) = load(write(tmp_path / "a.ply", vertex=vertex))[0].parts
        assert ("vertex_normals" in part.metadata) == kept
        if kept:
            np.testing.assert_allclose(part.metadata["vertex_normals"], normals / np.sqrt(0.75))


def picture(path, colour):
    PIL.Image.new("RGB", (4, 4), colour).save(path)


@pytest.mark.parametrize("names", [("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texture_s", "texture_t")])
def test_a_texture_by_vertex(tmp_path, names):
    picture(tmp_path / "a b.png", (1, 2, 3))
    vertex = [*XYZ, *channels("float", CORNERS[:, :2], names), *channels("uchar", COLOURS)]
    (part,) = load(write(tmp_path / "a.ply", vertex=vertex, comments=["TextureFile a b.png"]))[0].parts
    np.testing.assert_array_equal(part.visual.uv, CORNERS[:, :2])
    assert part.visual.material.baseColorTexture.getpixel((0, 0)) == (1, 2, 3)
    assert "color" not in part.visual.vertex_attributes  # the texture alone


@pytest.mark.parametrize("kind", FORMATS)
def test_textures_by_corner_of_a_face(tmp_path, kind):
    """As MeshLab writes them: coordinates of each corner, the number of the texture of each face."""
    picture(tmp_path / "0.png", (1, 2, 3))
    picture(tmp_path / "1.png", (4, 5, 6))
    wedges = [[number + value for corner in face for value in CORNERS[corner, :2]] for number, face in enumerate(SIDES)]
    face = [*FACES, ("list uchar float", "texcoord", wedges), ("int", "texnumber", [0, 1, 0, 1, 1, 1])]
    path = write(tmp_path / "a.ply", kind, face=face, comments=["TextureFile 0.png", "TextureFile 1.png"])
    parts = load(path)[0].parts
    assert [len(part.faces) for part in parts] == [4, 8]
    assert measured(triangles(parts))["volume"] == pytest.approx(1)
    for number, part in enumerate(parts):
        assert part.visual.material.baseColorTexture.getpixel((0, 0))[0] == 1 + 3 * number
        side = part.visual.uv - part.vertices[:, :2]
        assert set(side[part.faces].reshape(-1, 6)[:, 0]) == ({0, 2} if number == 0 else {1, 3, 4, 5})
        assert np.ptp(side[part.faces], axis=(1, 2)).max() < 1e-6


def test_a_texture_that_cannot_be_used_is_named(tmp_path):
    vertex = [*XYZ, *channels("float", CORNERS[:, :2], "st")]
    path = write(tmp_path / "a.ply", vertex=vertex, comments=["TextureFile gone.png"])
    (part,), problems = load(path)[0].parts, load(path)[1]
    assert "there is no such file" in problems["gone.png"]
    np.testing.assert_allclose(part.visual.material.baseColorFactor[:3], round(255 * GREY), atol=1)
    path = write(tmp_path / "b.ply", comments=["TextureFile gone.png"])
    assert "no texture coordinates" in load(path)[1]["gone.png"]


@pytest.mark.parametrize("kind", FORMATS)
def test_strips(tmp_path, kind):
    """Two in one list, wound as OpenGL does; of five corners, of which one triangle has no area; and of two."""
    flat = np.array([(0, 0, 0), (0, 1, 0), (1, 0, 0), (1, 1, 0), (2, 0, 0), (2, 1, 0)], dtype=float)
    vertex = [("float", axis, column) for axis, column in zip("xyz", flat.T, strict=True)]
    strips = [("list int int", "vertex_indices", [[1, 0, 3, 2, -1, 3, 2, 5, 4, 4, -1, 0, 1], [-1, 1, 0, 3]])]
    path = write(tmp_path / "a.ply", kind, vertex, strips)
    path.write_bytes(path.read_bytes().replace(b"element face", b"element tristrips"))
    (part,) = load(path)[0].parts
    assert part.faces.tolist() == [[1, 0, 3], [3, 0, 2], [3, 2, 5], [5, 2, 4], [1, 0, 3]]
    assert (part.face_normals[:, 2] > 0).all()


@pytest.mark.parametrize("kind", FORMATS)
def test_one_that_is_cut_off_anywhere(tmp_path, kind):
    data = write(tmp_path / "a.ply", kind, after=[("edge", [("int", "a", [1])])]).read_bytes()
    start = data.index(b"end_header\n") + 11
    last = len(data) - (4 if kind != "ascii" else 2)
    for keep in range(start, last, 3):
        text = data[:keep].rsplit(b" ", 1)[0] if kind == "ascii" else data[:keep]  # a digit less is another number
        if len(text) <= start:
            continue
        (tmp_path / "b.ply").write_bytes(text)
        with pytest.raises(ValueError, match="cut off: it says"):
            ply.read(tmp_path / "b.ply", Files(tmp_path / "b.ply"))


def test_counts_that_no_file_can_hold_and_points_alone(tmp_path):
    path = write(tmp_path / "a.ply", "binary_little_endian")
    for old, new in ((b"vertex 8", b"vertex 9999999999999"), (b"face 6", b"face 9999999999999")):
        (tmp_path / "b.ply").write_bytes(path.read_bytes().replace(old, new))
        with pytest.raises(UnusableObject, match="cut off: it says 9,999,999,999,999"):
            load(tmp_path / "b.ply")
    path.write_bytes(path.read_bytes().split(b"element face")[0] + b"end_header\n" + CORNERS.astype("<f4").tobytes())
    with pytest.raises(UnusableObject, match="points or lines only"):
        load(path)
    with pytest.raises(UnusableObject, match="no list `vertex_indices`"):
        load(write(tmp_path / "c.ply", face=[("list uchar int", "corners", SIDES)]))


def test_more_in_the_lines_of_a_text_than_the_header_has(tmp_path):
    """As MeshLab's colours of corners; numbers at the end of the file are an error."""
    path = write(tmp_path / "a.ply")
    head, body = path.read_text().split("end_header\n")
    path.write_text(head + "end_header\n" + "".join(line + " 9 1 1 1\n" for line in body.splitlines()))
    assert is_box(load(path)[0].parts[0])
    path.write_text(head + "end_header\n" + body + "9 1 1 1\n")
    with pytest.raises(UnusableObject, match="4 numbers more than its header says"):
        load(path)


def test_beside_blender(tmp_path):
    """Mixed polygons, concave ones too, in each format."""
    rng = np.random.default_rng(1)
    turn = np.sort(rng.random((40, 7)), axis=1) * 2 * np.pi
    rings = [
        np.c_[np.cos(t), np.sin(t), 0 * t][: 3 + n % 5] * rng.uniform(0.7, 1) + [3 * n, 0, n]
        for n, t in enumerate(turn)
    ]
    points, ends = np.concatenate(rings), np.cumsum([len(ring) for ring in rings])
    faces = [list(range(end - len(ring), end)) for ring, end in zip(rings, ends, strict=True)]
    vertex = [("double", axis, column) for axis, column in zip("xyz", points.T, strict=True)]
    face = [("list uchar int", "vertex_indices", faces)]
    paths = [write(tmp_path / f"{kind}.ply", kind, vertex, face) for kind in FORMATS]
    paths.append(CASES / "concave-polygon/u_profile.ply")
    for path, expected in zip(paths, by_blender(*paths), strict=True):
        assert_same(measured(triangles(load(path)[0].parts)), expected)
