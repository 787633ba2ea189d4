"""OBJ and MTL as their formats mean them: each case against what it was made of, and against Blender's import."""

import json

import numpy as np
import PIL.Image
import pytest
import trimesh

from palpate import mesh
from palpate.batch import UnusableObject
from palpate.mesh.load import load
from palpate.named_files import companions
from tests.mesh.reading import CASES, assert_same, by_blender, measured, triangles

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
UV = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
FACE = "f 1/1 2/2 3/3 4/4\n"
RED = [0.8, 0, 0]


def write(folder, text, **libraries):
    """A file a.obj, and libraries beside it by their names without the suffix."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, library in libraries.items():
        (folder / f"{name}.mtl").write_text(library)
    (folder / "a.obj").write_bytes(text if isinstance(text, bytes) else text.encode())
    return folder / "a.obj"


def parts_of(path):
    (parts, unit), problems = load(path)
    assert unit == 1
    return parts, problems


def colour(part):
    """Linear light: the material's, times that of the vertices."""
    factor = np.asarray(part.visual.material.baseColorFactor[:3]) / 255
    colours = part.visual.vertex_attributes.get("color")
    return factor if colours is None else factor * np.asarray(colours)[:, :3].mean(axis=0) / 255


# Of the meshes: triangles, shells, whether closed, area over the diagonal squared, volume over its cube.
BOX = (12, 1, True, 2, 3**-1.5)
SHAPES = {
    "obj-comments-after/box": BOX,
    "obj-tabs/box": BOX,
    "obj-mtllib-in-comment/box": BOX,
    "obj-vertex-colour-bytes/box": BOX,
    "obj-mixed-tabs/two_boxes": (24, 2, True, 12 / 18, 2 * 18**-1.5),
    "obj-second-mtllib/box": (24, 2, True, 12 / 18, 2 * 18**-1.5),
    "obj-negative-interleaved/three_boxes": (36, 3, True, 18 / 51, 3 * 51**-1.5),
    "concave-polygon/u_profile": (28, 1, True, 30 / 19, 7 * 19**-1.5),
    **dict.fromkeys(("uv-without-material/tile", "uv-without-material/without_vt"), (4, 2, False, 2 / 2.01, None)),
}
COLOURS = {
    "obj-mtllib-in-comment/box": [RED],
    "obj-second-mtllib/box": [[0, 0.8, 0], RED],  # by the names of the materials
    "obj-vertex-colour-bytes/box": [[0.5776, 0.0130, 0.0130]],  # of sRGB 200, 30, 30
    "uv-without-material/tile": [[0.8] * 3],
    "uv-without-material/without_vt": [[0.8] * 3],
}


@pytest.mark.parametrize("case", SHAPES)
def test_the_cases(tmp_path, case):
    record = mesh.prepare(CASES / f"{case}.obj", tmp_path, collision_faces=100)
    faces, shells, closed, area, volume = SHAPES[case]
    made, diagonal = record["visual.glb"], record["diagonal"]
    assert (made["faces"], made["shells"], made["closed"]) == (faces, shells, closed)
    assert made["area"] / diagonal**2 == pytest.approx(area, rel=1e-5)
    assert (made["volume"] and made["volume"] / diagonal**3) == (volume and pytest.approx(volume, rel=1e-3))
    assert record["source"]["problems"] == {}
    scene = trimesh.load_scene(tmp_path / "visual.glb", process=False)
    colours = [colour(part) for _, part in sorted(scene.geometry.items())]
    np.testing.assert_allclose(colours, COLOURS.get(case, [[0.8] * 3]), atol=0.5 / 255)


def test_a_slot_of_a_concave_polygon_is_open(tmp_path):
    parts, _ = parts_of(CASES / "concave-polygon/u_profile.obj")
    a, b, c = (parts[0].vertices[parts[0].faces][:, k, :2] for k in range(3))
    point = np.array([1.5, 2])
    sides = np.stack([np.cross(q - p, point - p) for p, q in ((a, b), (b, c), (c, a))], axis=1)
    assert not ((sides > 0).all(axis=1) | (sides < 0).all(axis=1)).any()


@pytest.mark.parametrize(("case", "stripes"), [("mtl-texture-scale", 8), ("mtl-in-subfolder", 2)])
def test_a_texture_is_drawn_as_its_library_says(tmp_path, case, stripes):
    """From left to right the plate has so many stripes, red and blue in turn."""
    path = CASES / case / "tile.obj"
    record = mesh.prepare(path, tmp_path, collision_faces=100)
    assert record["source"]["problems"] == {} and len(companions(path)) == 2
    (part,) = trimesh.load_scene(tmp_path / "visual.glb", process=False).geometry.values()
    left, right = (part.visual.uv[part.vertices[:, 0] * sign > 0.1, 0].mean() for sign in (-1, 1))
    u = np.linspace(left, right, 402)[1:-1] % 1
    image = np.asarray(part.visual.material.baseColorTexture.convert("RGB")).astype(int)
    row = image[0, (u * image.shape[1]).astype(int)]
    is_red = row[:, 0] > row[:, 2]
    assert is_red[0] and np.count_nonzero(is_red[1:] != is_red[:-1]) == stripes - 1


BLOCK = SQUARE + UV + "vn 0 0 1\n"
AGAIN = BLOCK.replace("v 0", "v 2").replace("v 1", "v 3")
# Files of one square (or of two, 2 apart), in many spellings.
ONE = {
    "no end": SQUARE + "f 1 2 3 4",
    "CRLF": (SQUARE + "f 1 2 3 4\n").replace("\n", "\r\n"),
    "CR": (SQUARE + "f 1 2 3 4\n").replace("\n", "\r"),
    "byte order mark": "\ufeff" + SQUARE + "f 1 2 3 4\n",
    "indented": SQUARE.replace("v ", " \tv\t ") + "\t f 1\t2  3 4 \t\n",
    "continued": SQUARE.replace("v 1 0", "v 1 \\\n 0") + "f 1 2 \\ \n\t3 \\\n4\n",
    "continued, CRLF": (SQUARE + "f 1 2 \\\n3 4\n").replace("\n", "\r\n"),
    "comments": "# c:\\models\\\n" + SQUARE.replace("\n", " # corner\n") + "f 1 2 3 4# side\n#f 1 2 3\n",
    "a comment without an end": SQUARE + "f\nf 1 2 3 4\nf 1\n# End",
    "capitals": SQUARE.upper() + "F 1 2 3 4\n",
    "old keyword": SQUARE + "fo 1 2 3 4\n",
    "faces first": "f 1 2 3 4\n" + SQUARE,
    "exponents": SQUARE.replace("1", "+10.0E-1").replace(" 0", " -0.e+1") + "f 1 2 3 4\n",
    "fewer corners": SQUARE + "f\nf 1\nf 1 2\nf 1 2 3 4\n",
    "points, lines, curves": SQUARE + "vp 0.5\np 1\nl 1 2\ncstype bezier\ndeg 1\ncurv 0 1 1 2\nend\nf 1 2 3 4\n",
    "UTF-16": ("\ufeff# é\n" + SQUARE + "f 1 2 3 4\n").encode("utf-16-be"),
    "end of DOS": SQUARE + "f 1 2 3 4\n\x1a",
    "weight": SQUARE.replace("\n", " 1.0\n") + "f 1 2 3 4\n",
    "u alone, and u v w": SQUARE + "vt 0\nvt 1 0 0\nvt 1 1\nvt 0 1\n" + FACE,
    "corners in all ways": BLOCK + "f 1//1 2//1 3//1\nf 1/1/1 3/3/1 4/4/1\n",
    "slashes at ends": BLOCK + "f 1/ 2/ 3/ 4/\n",
}
TWO = {
    "negative": BLOCK + "f -4/-4/-1 -3/-3/-1 -2/-2/-1 -1/-1/-1\n" + AGAIN + "f -4/-4/-1 -3/-3/-1 -2/-2/-1 -1/-1/-1\n",
    "mixed signs": BLOCK + "f -4/1 2/-3 -2/3 4/-1\n" + AGAIN + "f -4//-1 6//2 -2//-1 8//2\n",
}


@pytest.mark.parametrize("name", [*ONE, *TWO])
def test_the_same_shape_in_other_spellings(tmp_path, name):
    parts, problems = parts_of(write(tmp_path, (ONE | TWO)[name]))
    width, area = (1, 1) if name in ONE else (3, 2)
    expected = {"box": [[0, 0, 0], [width, 1, 0]], "area": area, "volume": 0}
    assert_same(measured(triangles(parts)), expected, 1e-12)
    assert problems == {}
    for part in parts:
        if part.visual.uv is not None:
            np.testing.assert_allclose(part.visual.uv, part.vertices[:, :2] % 2)
        if "vertex_normals" in part.metadata:
            assert (part.metadata["vertex_normals"] == (0, 0, 1)).all()


def test_a_homogeneous_vertex_is_divided_by_its_weight_and_named(tmp_path):
    text = "v 0 0 0 1\nv 2 0 0 2\nv 0.5 0.5 0 0.5\nv 0 1 0\nf 1 2 3 4\n"
    parts, problems = parts_of(write(tmp_path, text))
    assert measured(triangles(parts)) == {"box": [[0, 0, 0], [1, 1, 0]], "area": 1, "volume": 0}
    assert "weight" in problems["vertices"]


WRONG = {
    "f 1 x 3": "line 6, 'f 1 x 3': 'x' is no corner",
    "f 1 2,5 3": "line 6.*'2,5' is no corner",
    "f 1 1.0 3": "line 6.*'1.0' is no corner",
    "f 1-2 3 4": "line 6.*'1-2' is no corner",
    "f 1/1/1/1 2 3": "line 6.*'1/1/1/1' is no corner",
    "f /1 /2 /3": "line 6.*'/1' is no corner",
    "f 1 2 \\\n x 4": "line 6.*'x' is no corner",
    "f 1 2 9": "line 6.*'9' names a vertex that is not there: they are 1 to 4",
    "f 1 2 -5": "line 6.*'-5' names a vertex that is not there",
    "f 0 1 2": "line 6.*'0' names a vertex that is not there",
    "f 99999999999999999999 1 2": "line 6.*'99999999999999999999' is no corner",
    "vt 0 0\nf 1/1 2/2 3/1": "line 7.*'2/2' names a texture coordinate that is not there: they are 1 to 1",
    "vt 0 0\nf 1/0 2/0 3/0": "line 7.*'1/0' names a texture coordinate",
    "vn 0 0 1\nf 1//1 2//1 3//-2": "line 7.*'3//-2' names a normal that is not there",
    "v 0,5 0 0": "line 6.*could not convert string to float: b'0,5'",
    "v 0 0": "line 6.*it has 2 numbers, not 3",
    "v 0 0 0 1 1": "line 6.*it has 5 numbers",
    "v 0 0 0 1 1 0 0 1": "line 6.*it has 8 numbers",
    "v 0 0 0 0": "vertex 5: its fourth number, a weight, is 0",
    "vn 1 0": "line 6.*it has 2 numbers, not 3",
    "v1 0 0": "line 6, 'v1 0 0': it is no statement",
    "0.5 0.5": "line 6.*is no statement",
    "<<<<<<< ours": "line 6.*is no statement",
    "\0\0\0\0": "line 6.*is no statement",
}


@pytest.mark.parametrize("line", WRONG)
def test_what_is_wrong_in_a_line_is_an_error_that_names_it(tmp_path, line):
    path = write(tmp_path, f"{SQUARE}f 1 2 3\n{line}\nf 1 3 4\n")
    with pytest.raises(UnusableObject, match=WRONG[line]):
        load(path)


@pytest.mark.parametrize("end", ["f", "f 1/1 3", "f 1/1 3/3", "f 1/1 3/3 4", "f 1/1 3/3 4/", "v 1 2"])
def test_a_file_that_is_cut_off_within_a_line(tmp_path, end):
    with pytest.raises(UnusableObject, match="line 10, .*(cut off within this face|it has 2 numbers)"):
        load(write(tmp_path, SQUARE + UV + "f 1/1 2/2 3/3\n" + end))


def test_what_is_not_read_is_noted(tmp_path):
    text = f"{SQUARE}f 1//1 2//1 3//1\nf 1/1 3/3 4/4\nsurf 0 1 0 1 1 2 3 4\ncall b.obj\nshading 3\nshading 4\n"
    _, problems = parts_of(write(tmp_path, text))
    assert set(problems) == {"surf", "call", "shading", "normals", "texture coordinates"}
    with pytest.raises(UnusableObject, match="line 1, .* is no statement of an OBJ"):
        load(write(tmp_path, "404: not found\n"))


# What follows a position, and the colour in sRGB.
AFTER = {
    "1 0 0.5": (255, 0, 128),
    "200 30 30": (200, 30, 30),
    "1 0 0.5 0.4": (255, 0, 128),  # the last is an opacity
    "200 30 30 255": (200, 30, 30),
}


@pytest.mark.parametrize("after", AFTER)
def test_colours_after_vertices(tmp_path, after):
    (part,), problems = parts_of(write(tmp_path, SQUARE.replace("\n", f" {after}\n") + "f 1 2 3 4\n"))
    srgb = np.array(AFTER[after]) / 255
    expected = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(colour(part), expected, atol=0.5 / 255)
    assert problems == {}


def test_colours_of_some_vertices_and_beside_materials(tmp_path):
    red = SQUARE.replace("\n", " 1 0 0\n")
    (part,), _ = parts_of(write(tmp_path, red + "v 0 2 0\nf 1 2 3 4\nf 4 3 5\n"))
    assert part.visual.vertex_attributes["color"].tolist() == [[255, 0, 0, 255]] * 4 + [[204, 204, 204, 255]]
    text = "mtllib a.mtl\n" + red + SQUARE + "f 1 2 3 4\nusemtl m\nf 5 6 7 8\n"
    (first, second), _ = parts_of(write(tmp_path, text, a="newmtl m\nKd 0 0 0.8\n"))
    assert colour(first).tolist() == [1, 0, 0] and colour(second).tolist() == [0, 0, 0.8]
    (part,), problems = parts_of(write(tmp_path, "mtllib no.mtl\nusemtl m\n" + red + "f 1 2 3 4\n"))
    assert colour(part).tolist() == [1, 0, 0] and "in the colours of its vertices" in problems["no.mtl"]


# The lines before the face of material m, whose library is a.mtl or one of two.
LIBRARIES = {
    "late": ("usemtl m\n", "mtllib a.mtl\n"),
    "two lines": ("mtllib b.mtl\nmtllib a.mtl\nusemtl m\n", ""),
    "two names": ("mtllib b.mtl a.mtl\nusemtl m\n", ""),
    "one is missing": ("mtllib gone.mtl a.mtl\nusemtl m\n", ""),
    "a space": ("mtllib a b.mtl\nusemtl m\n", ""),
    "two names and a space": ("mtllib b.mtl a b.mtl\nusemtl m\n", ""),
    "quotes": ('mtllib "a b.mtl" "b.mtl"\nusemtl m\n', ""),
    "tabs and blanks": ("\tmtllib\ta.mtl \n usemtl\tm \n", ""),
    "capitals": ("MTLLIB a.mtl\nUseMtl m\n", ""),
    "comments": ("# mtllib b.mtl\n#mtllib b.mtl\nmtllib a.mtl # mine\nusemtl m # red\n", ""),
    "continued": ("mtllib \\\n a.mtl\nusemtl \\\nm\n", ""),
    "a path": ("mtllib ./lib\\c.mtl\nusemtl m\n", ""),
}


@pytest.mark.parametrize("name", LIBRARIES)
def test_libraries_are_found_however_they_are_named(tmp_path, name):
    before, after = LIBRARIES[name]
    red, other = "newmtl m\nKd 0.8 0 0\n", "newmtl n\nKd 0 0.8 0\n"
    library = "a b" if " b" in before and ("space" in name or "quotes" in name) else "a"
    write(tmp_path / "lib", "", c=red)
    (part,), problems = parts_of(write(tmp_path, before + SQUARE + "f 1 2 3 4\n" + after, b=other, **{library: red}))
    np.testing.assert_allclose(colour(part), RED, atol=0.5 / 255)
    assert list(problems) == (["gone.mtl"] if "missing" in name else [])
    files = {"lib/c.mtl"} if "path" in name else {f"{library}.mtl"}
    files |= (
        {"b.mtl"}
        if "b.mtl" in before.replace("a b.mtl", "").replace("# mtllib b", "").replace("#mtllib b", "")
        else set()
    )
    assert set(companions(tmp_path / "a.obj")) == files


def test_materials_that_no_library_has(tmp_path):
    (part,), problems = parts_of(write(tmp_path, "usemtl m\n" + SQUARE + "f 1 2 3 4\n"))
    assert colour(part).tolist() == [0.8] * 3 and problems == {}
    text = "mtllib a.mtl\n" + SQUARE + "f 1 2 3\nusemtl gone\nf 1 3 4\n"
    (first, second), problems = parts_of(write(tmp_path, text, a="newmtl m\n"))
    assert colour(first).tolist() == [0.8] * 3 and colour(second).round(1).tolist() == [0.5] * 3
    assert "no material library has it: drawn in neutral grey" in problems["gone"]


def test_names_of_materials(tmp_path):
    """With blanks, with a #, twice in a library (the first counts), and in two (the first, too)."""
    names = {"old oak": [0.5, 0, 0], "Material #2": [0, 0.5, 0], "Material #3": [0, 0, 0.5], "twice": [0.5, 0.5, 0],
             "both": [0, 0.5, 0.5]}  # fmt: skip
    first = "".join("newmtl {}\nKd {} {} {}\n".format(name, *kd) for name, kd in names.items())
    second = "newmtl twice\nKd 1 1 1\n"
    text = SQUARE + "mtllib a.mtl b.mtl\n" + "".join(f"usemtl {name}\nf 1 2 3\n" for name in names)
    path = write(tmp_path, text.replace("old oak", "old  oak"), a=first + second, b="newmtl both\nKd 1 1 1\n")
    parts, problems = parts_of(path)
    assert problems == {} and [part.metadata["name"] for part in parts] == sorted(names)
    for part in parts:
        np.testing.assert_allclose(colour(part), names[part.metadata["name"]], atol=1 / 255)


# Statements of a material, and base colour, metallic and roughness.
MATERIALS = {
    "Kd 0.2 0.4 0.6": ([0.2, 0.4, 0.6], 0, 1),
    "\tkd\t0.2 0.4 0.6 # blue": ([0.2, 0.4, 0.6], 0, 1),
    "Kd 0.4": ([0.4] * 3, 0, 1),
    "Kd 2 -1 0": ([1, 0, 0], 0, 1),
    "Ns 250": ([0.8] * 3, 0, 0.5),
    "Ns 250\nPr 0.3\nPm 0.7\nd 0.1\nTr 0.9": ([0.8] * 3, 0.7, 0.3),
    "Kd spectral red.rfl 1": ([0.8] * 3, 0, 1),
    "Kd xyz 0.2 0.4 0.6": ([0.8] * 3, 0, 1),
    "Kd 0,2 0,4 0,6": ([0.8] * 3, 0, 1),
}


@pytest.mark.parametrize("statements", MATERIALS)
def test_what_a_library_says_of_a_material(tmp_path, statements):
    path = write(tmp_path, "mtllib a.mtl\nusemtl m\n" + SQUARE + "f 1 2 3 4\n", a=f"newmtl m\n{statements}\n")
    (part,), problems = parts_of(path)
    base, metallic, roughness = MATERIALS[statements]
    np.testing.assert_allclose(colour(part), base, atol=0.5 / 255)
    material = part.visual.material
    assert (material.metallicFactor, material.roughnessFactor) == (metallic, pytest.approx(roughness))
    assert bool(problems) == any(word in statements for word in ("spectral", "xyz", ","))


# What a map statement says, the scale and the offset of its coordinates, and whether it is clamped.
MAPS = {
    "t.png": (1, 1, 0, 0, False),
    "-s 4 t.png": (4, 1, 0, 0, False),
    "-s 4 2 t.png": (4, 2, 0, 0, False),
    "-s 4 4 1 2.png": (4, 4, 0, 0, False),
    "-o 0.5 -.25 0 -s 2 3 1 a b.png": (2, 3, 0.5, -0.25, False),
    "-blendu on -mm 0 1 -bm 0.5 -imfchan r -texres 512 -type sphere -t 0 0 0 -clamp on t.png": (1, 1, 0, 0, True),
    "-clamp off -S 2 2 -x.png": (2, 2, 0, 0, False),
    "t.png # oak": (1, 1, 0, 0, False),
    '"a b.png"': (1, 1, 0, 0, False),
    "maps\\u.png": (1, 1, 0, 0, False),
    "C:\\My pictures\\t.png": (1, 1, 0, 0, False),
}


@pytest.fixture(scope="module")
def mapped(tmp_path_factory):
    """Folders with a textured square for each of `MAPS`."""
    folders = {}
    for number, (statement, _) in enumerate(MAPS.items()):
        folder = folders[statement] = tmp_path_factory.mktemp(f"map{number}")
        library = f"newmtl m\nKd 0 0 0\n\tmap_Kd\t{statement} \n"
        write(folder, "mtllib a.mtl\nusemtl m\n" + SQUARE + UV + FACE, a=library)
        (folder / "maps").mkdir()
        for name in ("t", "2", "a b", "-x", "maps/u"):
            PIL.Image.new("RGB", (2, 2), (250, 10, 10)).save(folder / f"{name}.png")
    return folders


@pytest.mark.parametrize("statement", MAPS)
def test_options_of_a_texture(mapped, statement):
    path = mapped[statement] / "a.obj"
    (part,), problems = parts_of(path)
    *numbers, clamped = MAPS[statement]
    assert problems == {} and part.visual.material.baseColorTexture.size == (2, 2)
    assert colour(part).tolist() == [1, 1, 1]
    np.testing.assert_allclose(part.visual.uv, part.vertices[:, :2] * numbers[:2] + numbers[2:])
    assert part.metadata.get("wrap") == (("clamp", "clamp") if clamped else None)
    assert len(companions(path)) == 2


def test_textures_are_relative_to_their_library_first(tmp_path):
    """Then to the mesh, then beside it by their last part; a face without coordinates has the colour alone."""
    folder = tmp_path / "lib"
    text = "mtllib lib/a.mtl\n" + SQUARE + UV + "usemtl m\n" + FACE + "usemtl n\n" + FACE + "usemtl o\nf 1 2 3\n"
    path = write(tmp_path, text)
    names = ("m", "m.png"), ("n", "x/n.png"), ("o", "m.png")
    library = "".join(f"newmtl {name}\nKd 0.8 0 0\nmap_Kd {file}\n" for name, file in names)
    write(folder, "", a=library)
    for place, level in ((folder / "m.png", 100), (tmp_path / "m.png", 50), (tmp_path / "n.png", 20)):
        PIL.Image.new("L", (1, 1), level).save(place)
    (m, n, o), problems = parts_of(path)
    levels = [part.visual.material.baseColorTexture.getpixel((0, 0)) for part in (m, n)]
    assert levels == [100, 20] and problems == {}
    np.testing.assert_allclose(colour(o), RED, atol=0.5 / 255)
    assert companions(path) == ["lib/a.mtl", "lib/m.png", "n.png"]


# Blender does not read these: nothing of them, or not the first vertex, or no face.
NOT_IN_BLENDER = ("capitals", "old keyword", "comments", "CR", "byte order mark", "UTF-16", "faces first")


def test_as_blender_imports_them(tmp_path, mapped):
    """Boxes, areas and volumes of the cases and spellings; colours; scales and offsets of textures."""
    paths = [CASES / f"{case}.obj" for case in SHAPES]
    paths += [write(tmp_path / name, text) for name, text in (ONE | TWO).items() if name not in NOT_IN_BLENDER]
    maps = [statement for statement in MAPS if "-s" in statement and "-o" in statement or statement.startswith("-s")]
    textured = [mapped[statement] / "a.obj" for statement in maps] + [CASES / "mtl-texture-scale/tile.obj"]
    made = by_blender(*paths, *textured)
    for path, expected in zip(paths, made, strict=False):
        parts, _ = parts_of(path)
        assert_same(measured(triangles(parts)), expected, 1e-7)
        for part in parts:
            if part.visual.material.name is not None:
                np.testing.assert_allclose(
                    colour(part), expected["materials"][part.visual.material.name]["colour"], atol=0.5 / 255
                )
    for path, expected in zip(textured, made[len(paths) :], strict=True):
        (part,), _ = parts_of(path)
        ((scale, offset),) = (look["mapping"] for look in expected["materials"].values())
        plain = part.vertices[:, :2]
        np.testing.assert_allclose(part.visual.uv, plain * scale + offset, atol=1e-6)


def test_a_clamped_texture_is_clamped_in_what_is_rendered(tmp_path, mapped):
    for statement in MAPS:
        if "-clamp" in statement:
            mesh.prepare(mapped[statement] / "a.obj", tmp_path, collision_faces=100)
            data = (tmp_path / "visual.glb").read_bytes()
            tree = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
            clamped = {sampler.get(key) for sampler in tree.get("samplers", []) for key in ("wrapS", "wrapT")}
            assert (clamped == {33071}) == MAPS[statement][-1]  # CLAMP_TO_EDGE
