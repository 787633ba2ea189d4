"""The files that a mesh file names: those of every format, bounded, within the source's folder."""

import json
import os
import shutil

import PIL.Image
import pytest

from palpate import mesh
from palpate.named_files import (
    HEAD,
    SMALL,
    companions,
    find,
    is_outside,
    joined_lines,
    library_names,
    map_statement,
    texture_pixels,
    unusable,
)
from tests.mesh.written import FORMATS, gltf, picture, write

NAMES = {"obj": ["body.mtl", "picture.png"], "gltf": ["body.bin", "picture.png"]}
NAMES |= {suffix: ["picture.png"] for suffix in ("glb", "ply", "dae")} | {
    suffix: [] for suffix in ("stl", "off", "3mf")
}


@pytest.mark.parametrize("suffix", FORMATS)
def test_each_format_names_its_files(tmp_path, suffix):
    assert set(NAMES) == set(FORMATS) == set(mesh.FORMATS)
    path = write(tmp_path, suffix, colour=(1, 1, 1), texture=bool(NAMES[suffix]))
    assert companions(path) == NAMES[suffix]
    assert texture_pixels(path) == 0  # a picture of 256 x 128 in a few kB
    for name in NAMES[suffix]:
        (tmp_path / name).unlink()
    assert companions(path) == []


def test_names_with_escapes_options_spaces_and_other_encodings(tmp_path):
    for name in ("a b.png", "é.png", "wood grain.png"):
        picture().save(tmp_path / name)
    tree = {"images": [{"uri": "a%20b.png"}, {"uri": "é.png"}, {"uri": "data:image/png;base64,AAAA"}]}
    (tmp_path / "m.gltf").write_text(json.dumps(tree))  # writes é as an escape
    assert companions(tmp_path / "m.gltf") == ["a b.png", "é.png"]
    (tmp_path / "m.obj").write_text("mtllib m.mtl\r\n")
    (tmp_path / "m.mtl").write_bytes("map_Kd -s 2 2 2 wood grain.png\r\n\tMAP_KD é.png\n".encode("latin-1"))
    assert companions(tmp_path / "m.obj") == ["m.mtl", "wood grain.png", "é.png"]


def test_libraries_of_an_obj_wherever_it_names_them(tmp_path):
    """Several lines and names, tabs, capitals, a continued line; late ones not in the head; none of a comment."""
    late = "v 0 0 0\n" * HEAD + "mtllib late.mtl\n"
    text = "# mtllib no.mtl\n#mtllib no.mtl\n\tMtlLib\ta.mtl  b.mtl # no.mtl\nmtllib \\\r\n c d.mtl\n\\no\n" + late
    (tmp_path / "m.obj").write_bytes(text.encode())
    names = ["a.mtl", "b.mtl", "c d.mtl", "late.mtl"]
    for name in [*names, "no.mtl", "c", "no"]:
        (tmp_path / name).write_text("")
    assert companions(tmp_path / "m.obj") == names
    assert companions(tmp_path / "m.obj", head=HEAD) == names[:3]


def test_textures_are_relative_to_their_library_then_to_the_mesh(tmp_path):
    (tmp_path / "lib").mkdir()
    (tmp_path / "m.obj").write_text("mtllib lib/m.mtl\n")
    (tmp_path / "lib/m.mtl").write_text(
        "newmtl m\n\tmap_Kd\t-s 2 2 1 both.png # map_Kd no.png\n# map_Kd no.png\nmap_Ks -clamp on beside.png\n"
        "bump -bm 0.5 ../up.png\nmap_d gone.png\n"
    )
    for name in ("both.png", "lib/both.png", "beside.png", "no.png", "lib/no.png", "up.png"):
        (tmp_path / name).write_bytes(b"")
    assert companions(tmp_path / "m.obj") == ["beside.png", "lib/../up.png", "lib/both.png", "lib/m.mtl"]


@pytest.mark.parametrize(
    ("rest", "options", "name"),
    [
        ("t.png", {}, "t.png"),
        ("-s 1 2 3 4 t.png", {"-s": ["1", "2", "3"]}, "4 t.png"),
        ("-S 1 2.png", {"-s": ["1"]}, "2.png"),
        ("-o -.5 1e-1 -clamp on -a b.png", {"-o": ["-.5", "1e-1"], "-clamp": ["on"]}, "-a b.png"),
        ("-mm 0 1 -bm 2  a  b.png ", {"-mm": ["0", "1"], "-bm": ["2"]}, "a  b.png"),
        ("-colorspace linear t.png", {"-colorspace": ["linear"]}, "t.png"),
        ("-s 1", {}, "-s 1"),
        ("", {}, ""),
    ],
)
def test_options_of_a_map_statement(rest, options, name):
    assert map_statement(rest) == (options, name)


def test_names_of_libraries_that_are_not_there(tmp_path):
    path = tmp_path / "m.obj"
    assert library_names(path, "my file.mtl # old") == ["my file.mtl"]
    (tmp_path / "a.mtl").write_text("")
    assert library_names(path, "gone.mtl a.mtl") == ["gone.mtl", "a.mtl"]
    assert library_names(path, "") == []


def test_lines_keep_their_numbers_where_some_are_continued():
    joined = joined_lines(b"\xef\xbb\xbff 1 \\\r\n2 \\ \t\r\n3\r\nC:\\a b\rlast\\x\x1a")
    assert joined == b"f 1  2  3\n\n\nC:\\a b\nlast\\x"
    assert joined_lines(b"# C:\\a\\\nv 0\n") == b"# C:\\a\\\nv 0\n"


# Files with their contents, the mesh first, and what it names; a file of None is a pipe.
HOSTILE = {
    "long map": (
        {
            "a.obj": "mtllib a.mtl\n",
            "a.mtl": f"map_Kd {'x' * 300}.png\nmap_Kd {'y/' * 5000}\nmap_Kd {'- ' * 100_000}\n",
        },
        ["a.mtl"],
    ),
    "long uri": ({"a.gltf": json.dumps({"images": [{"uri": "x" * 300}, {"uri": "y" * 100_000}]})}, []),
    "deep": ({"a.gltf": '{"a":' + "[" * 200_000 + "]" * 200_000 + "}"}, []),
    # 3 MB: with a quadratic search this would take days.
    "blank lines": (
        {"a.obj": "mtllib a.mtl\n", "a.mtl": "\n" * 1_000_000 + " " * 1_000_000 + "\n" + "map_Kd" + " " * 1_000_000},
        ["a.mtl"],
    ),
    "spaces": ({"a.dae": "<init_from>" + " " * 1_000_000 + "<init_from>" * 100_000}, []),
    "pipes": (
        {
            "a.obj": "mtllib a.mtl\nmtllib /dev/zero\nmtllib b.mtl\n",
            "b.mtl": "map_Kd t.png\nmap_Kd /dev/zero\n",
            **dict.fromkeys(("a.mtl", "t.png")),
        },
        ["b.mtl"],
    ),
    "pipe": ({"a.obj": None}, []),
    "libraries": (
        {
            "a.obj": "mtllib " + "a " * 1_000_000 + "\n" + "mtllib a.mtl\n" * 300_000,
            "a.mtl": "map_Kd " + "-s 1 " * 9999,
        },
        ["a.mtl"],
    ),
    "backslashes": ({"a.obj": "\\" * 1_000_000 + "\n" + "\\ " * 300_000 + "\n" + "\\\n" * 300_000}, []),
}


@pytest.mark.parametrize("files, expected", HOSTILE.values(), ids=HOSTILE)
def test_whatever_a_file_says_its_names_are_found_soon(tmp_path, files, expected):
    for name, content in files.items():
        os.mkfifo(tmp_path / name) if content is None else (tmp_path / name).write_text(content)
    path = tmp_path / next(iter(files))
    assert companions(path, "/") == expected
    assert texture_pixels(path, "/") == 0


def test_what_can_be_no_mesh_file(tmp_path):
    os.mkfifo(tmp_path / "a.obj")
    (tmp_path / "a.stl").write_bytes(b"")
    assert "pipe" in unusable(tmp_path / "a.obj") and "folder" in unusable(tmp_path)
    assert "UTF-8" in unusable(b"caf\xe9.stl".decode("utf-8", "surrogateescape").encode("utf-8", "backslashreplace"))
    assert not unusable(tmp_path / "a.stl") and not unusable(tmp_path / "gone.stl")


def test_pixels_of_pictures_beside_and_within(tmp_path):
    noise = picture().resize((512, 256)).effect_spread(60)
    for suffix in ("obj", "ply", "gltf"):
        path = write(tmp_path / suffix, suffix, texture=True)
        noise.save(path.with_name("picture.png"))
        assert texture_pixels(path) == 512 * 256
        path.with_name("picture.png").write_bytes(b"\x89PNG" + bytes(100_000))
        assert texture_pixels(path) == 0
    noise.save(tmp_path / "gltf/picture.png")
    loaded = mesh.prepare(tmp_path / "gltf/body.gltf", tmp_path / "out")
    assert loaded["source"]["problems"] == {}
    assert texture_pixels(tmp_path / "out/visual.glb") == 512 * 256


def test_pixels_of_the_largest_picture(tmp_path, monkeypatch):
    """PIL by itself, as the workflow has it, takes a picture of this size for a bomb."""
    path = write(tmp_path, "obj", texture=True)
    PIL.Image.new("L", (16384, 16384)).save(tmp_path / "picture.png")
    monkeypatch.setattr(PIL.Image, "MAX_IMAGE_PIXELS", 89_478_485)
    assert texture_pixels(path) == 16384**2


def test_a_picture_that_is_too_large_is_named_so_whatever_ran_before(tmp_path):
    path = write(tmp_path, "obj", texture=True)
    (tmp_path / "picture.png").write_bytes(b"P5 33000 33000 255\n" + bytes(SMALL))
    assert texture_pixels(path) == 0
    problems = mesh.prepare(path, tmp_path / "out")["source"]["problems"]
    assert "it has 33000 x 33000 pixels, and at most 16384 a side" in problems["picture.png"]


@pytest.fixture
def source(tmp_path):
    """A source's folder with a mesh two folders deep, and pictures within it and outside."""
    folder = tmp_path / "source"
    path = write(folder / "mug/blue", "obj", texture=True)
    picture().save(tmp_path / "secret.png")
    picture().save(folder / "shared.png")
    return folder, path


def test_files_outside_the_source_are_refused(source, tmp_path):
    folder, path = source
    for name in ("../../../secret.png", str(tmp_path / "secret.png")):
        assert find(path, name, folder) is None and is_outside(path, name, folder)
        assert find(path, name, "/") and not is_outside(path, name, "/")
    for name in ("../../shared.png", "picture.png", str(folder / "shared.png")):
        assert find(path, name, folder) and not is_outside(path, name, folder)
    assert find(path, "gone.png", folder) is None and not is_outside(path, "gone.png", folder)
    path.with_suffix(".mtl").write_text("newmtl skin\nmap_Kd ../../../secret.png\n")
    assert companions(path, folder) == ["body.mtl"]
    assert companions(path, "/") == ["../../../secret.png", "body.mtl"]
    record = mesh.prepare(path, tmp_path / "out", root=folder)
    assert "outside the source's folder" in record["source"]["problems"]["../../../secret.png"]
    assert mesh.prepare(path, tmp_path / "out", root="/")["source"]["problems"] == {}


def test_a_buffer_outside_is_refused(source, tmp_path):
    folder, path = source
    gltf(path.with_suffix(".gltf"), None, True, "material")
    shutil.move(path.with_suffix(".bin"), tmp_path / "body.bin")
    text = path.with_suffix(".gltf").read_text().replace("body.bin", str(tmp_path / "body.bin"))
    path.with_suffix(".gltf").write_text(text)
    with pytest.raises(mesh.UnusableObject, match="outside the source's folder"):
        mesh.prepare(path.with_suffix(".gltf"), tmp_path / "out", root=folder)
    mesh.prepare(path.with_suffix(".gltf"), tmp_path / "out", root="/")


def test_links_of_the_user_are_followed_and_those_of_a_name_are_not(source, tmp_path):
    """A class, or a picture, may be a link; from a linked class a name still does not reach beside it."""
    folder, path = source
    shutil.move(folder / "mug", tmp_path / "elsewhere")
    (folder / "mug").symlink_to(tmp_path / "elsewhere")
    (tmp_path / "elsewhere/near.png").write_bytes((tmp_path / "secret.png").read_bytes())
    (path.parent / "linked.png").symlink_to(tmp_path / "secret.png")
    assert find(path, "linked.png", folder) and find(path, "../near.png", folder)
    assert find(path, "../../secret.png", folder) is None
