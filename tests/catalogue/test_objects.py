"""Objects as people have them: patterns, several formats of one object, tables of objects, published layouts."""

import io
import json
import os
import re
import shutil
import unicodedata
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml
from PIL import Image, ImageOps

from palpate.batch import UnusableObject
from palpate.catalogue import (
    SPLITS,
    CatalogueEntry,
    CatalogueError,
    Source,
    assign_split,
    checksum,
    class_counts,
    copies,
    file_name,
    scan,
    splits_of,
    unread_lines,
)
from palpate.catalogue.source import read_object_table
from palpate.catalogue.sources import all_classes
from palpate.catalogue.split import PAPER_SPLIT
from palpate.catalogue.table import companions
from palpate.configuration import ConfigError
from palpate.mesh import prepare
from tests.catalogue.test_sources import names, patterns_of_classes, tree
from tests.catalogue.whole import whole_catalogue
from tests.mesh.written import write


def source(path, kind="folder", **keys):
    return Source(kind, path, **keys)


def ball():
    return trimesh.creation.icosphere(subdivisions=1)


def painted(folder: Path, image: str = "texture.png") -> Path:
    """`textured.obj` with its material, which names a red texture without its folder; `image` is where that lies."""
    folder.mkdir(parents=True, exist_ok=True)
    box = trimesh.creation.box((0.1, 0.06, 0.04))
    box.visual = trimesh.visual.TextureVisuals(
        uv=np.full((len(box.vertices), 2), 0.5), image=Image.new("RGB", (4, 4), (200, 10, 10))
    )
    text, files = trimesh.exchange.obj.export_obj(box, return_texture=True, mtl_name="textured.mtl")
    (folder / "textured.obj").write_text(text)
    texture = next(data for name, data in files.items() if name.endswith(".png"))
    (folder / image).parent.mkdir(parents=True, exist_ok=True)
    (folder / image).write_bytes(texture)
    material = re.sub(r"map_Kd .*", f"map_Kd {Path(image).name}", files["textured.mtl"].decode())
    (folder / "textured.mtl").write_text(material)
    return folder / "textured.obj"


@pytest.fixture
def formats(tmp_path):
    """A folder with several formats of one object."""
    (tmp_path / "can").mkdir()
    for suffix in ("ply", "stl", "obj"):
        ball().export(tmp_path / f"can/can.{suffix}")
    return tmp_path


def test_files_of_one_object_are_one_object_and_formats_with_textures_come_first(formats):
    (entry,) = scan(source(formats), {"can": "all"})
    assert (entry.object, entry.source, entry.others) == ("can", "can/can.obj", ("can/can.ply", "can/can.stl"))
    (row,) = whole_catalogue(source(formats), {"can": "all"}).to_dict("records")
    assert row["others"] == "can/can.ply; can/can.stl" and (row["up"], row["scale"]) == ("z", "diagonal")
    assert [each.source for each in scan(source(formats, pattern="{class}/*.stl"), {"can": "all"})] == ["can/can.stl"]


def test_files_that_only_look_alike_are_objects_of_their_own(tmp_path):
    tree(tmp_path, "mug/a.obj", "mug/A.stl", "mug/b/a.obj", "mug/untextured2.obj", "mug/textureless.obj", "mug/2.obj")
    assert len(scan(source(tmp_path), {"mug": "all"})) == 6


def test_two_objects_of_one_name_get_names_of_their_own(tmp_path, caplog):
    """The one with fewer folders keeps it, so that an object that is there keeps its name and its split."""
    tree(tmp_path, "mug/x-a.obj")
    before = names(scan(source(tmp_path), {"mug": "all"}))
    tree(tmp_path, "mug/x/a.obj", "mug-x/a.obj")
    entries = scan(source(tmp_path), {"mug": "all", "mug-x": "all"})
    found = {entry.source: entry.object for entry in entries}
    assert len(set(found.values())) == 3 and found["mug/x-a.obj"] == before[0] == "mug-x-a"
    assert "mug/x/a.obj: the name mug-x-a is another object's" in caplog.text


def test_a_pattern_begins_at_the_path(tmp_path):
    """Names are what its wildcards stand for; without `{class}` there is one class."""
    tree(tmp_path, *(f"{name}/google_16k/{file}.obj" for name in ("002_can", "003_box") for file in ("textured", "x")))
    tree(tmp_path, "004_bag/google_64k/textured.obj", ".hidden/google_16k/textured.obj")
    given = source(tmp_path, pattern="*/google_16k/textured.obj")
    assert all_classes(given) == {"object": "all"}
    assert names(scan(given, {"object": "all"})) == ["object-002_can", "object-003_box"]
    assert names(scan(given, {"food": 2})) == ["food-002_can", "food-003_box"]
    with pytest.raises(CatalogueError, match=r"one class, the config has a, b.*CSV file"):
        scan(given, {"a": 1, "b": 1})
    with pytest.raises(CatalogueError, match=r"no mesh found for \*/poisson/.*`\{class\}/\.\.\.` has classes"):
        scan(source(tmp_path, pattern="*/poisson/*.obj"), {"food": 1})


def test_a_pattern_with_classes(tmp_path):
    tree(tmp_path, "kitchen/coffee mug/a/google_16k/textured.obj", "kitchen/pan/b/google_16k/textured.obj")
    tree(tmp_path, "kitchen/[x]/c/google_16k/textured.obj", "kitchen/notes/read.me")
    given = source(tmp_path, pattern="kitchen/{class}/*/google_16k/textured.obj")
    assert all_classes(source(tmp_path / "kitchen", pattern="{class}/**/*.obj")).keys() == {"coffee mug", "pan", "[x]"}
    entries = scan(given, {"pan": "all", "coffee mug": "all"})
    assert names(entries) == ["pan-b", "coffee_mug-a"]
    assert [entry.class_name for entry in entries] == ["pan", "coffee mug"]
    with pytest.raises(CatalogueError, match="kitchen/pot: no such folder.*has .*coffee mug"):
        scan(given, {"pot": "all"})


def test_a_flat_folder_has_a_pattern_too(tmp_path):
    tree(tmp_path, "a.obj", "b.stl", "c.OBJ", "notes.txt", "deep/d.obj")
    assert names(scan(source(tmp_path, pattern="*"), {"part": "all"})) == ["part-a", "part-b", "part-c"]
    assert len(scan(source(tmp_path, pattern="**"), {"part": "all"})) == 4


def test_names_of_classes_in_files():
    assert file_name("coffee-mug") == "coffee-mug" and file_name("coffee mug") == "coffee_mug"
    assert file_name("чашка") != file_name("ложка")
    for name in ("it's", "a & b"):
        assert file_name(name).isascii() and not set(file_name(name)) & set(" &'/")
    assert file_name("чашка") == "чашка" and file_name("चम्मच") == "चम्मच"
    assert len(file_name("杯" * 150).encode()) <= 200


def test_the_up_axis_is_the_formats(tmp_path):
    tree(tmp_path, *(f"mug/{name}" for name in ("a.glb", "b.GLTF", "c.obj", "d.stl", "e.dae")))
    assert [entry.up for entry in scan(source(tmp_path), {"mug": "all"})] == ["y", "y", "z", "z", "y"]
    for said, up in (("X_UP", "x"), ("Y_UP", "y"), ("Z_UP", "z")):
        (tmp_path / "mug/e.dae").write_text(f"<COLLADA><asset><up_axis> {said} </up_axis></asset></COLLADA>")
        assert scan(source(tmp_path), {"mug": "all"})[-1].up == up
    assert {entry.up for entry in scan(source(tmp_path, up="x"), {"mug": "all"})} == {"x"}


def test_a_table_says_class_and_split(tmp_path):
    """A longer path counts for more."""
    tree(tmp_path, "a/1.glb", "a/2.obj", "b/deep/3.obj", "b/4.obj")
    (tmp_path / "objects.csv").write_text(
        "\ufeffpath, class, split\na/1.glb, tea pot, test\n"
        "b/deep, tea pot, validation\nb/deep/3.obj,, test\n\na,, train\n"
    )
    given = source(tmp_path, objects=str(tmp_path / "objects.csv"))
    assert list(all_classes(given)) == ["a", "b", "tea pot"]
    entries = scan(given, {"tea pot": "all", "a": "all", "b": "all"})
    assert {entry.object: (entry.class_name, entry.split, entry.up) for entry in entries} == {
        "tea_pot-1": ("tea pot", "test", "y"),
        "tea_pot-deep-3": ("tea pot", "test", "z"),
        "a-2": ("a", "train", "z"),
        "b-4": ("b", "", "z"),
    }
    splits = splits_of(entries, {"train": 0, "validation": 1, "test": 0})
    assert list(splits.values()) == ["test", "test", "train", "validation"]
    assert list(whole_catalogue(given, {"tea pot": "all"})["split"]) == ["test", "test"]


def test_classes_of_a_flat_folder_come_from_the_table(tmp_path):
    tree(tmp_path, *(f"{name}.obj" for name in "abc"))
    (tmp_path / "objects.csv").write_text("path,class\na.obj,mug\nb.obj,pan\n")
    given = source(tmp_path, pattern="*", objects=tmp_path / "objects.csv")
    assert all_classes(given) == {"mug": "all", "object": "all", "pan": "all"}
    assert names(scan(given, {"pan": 1, "mug": 1})) == ["pan-b", "mug-a"]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("name,split\n", "header is name, split: expected path, and"),
        ("", "header is missing"),
        ("class,split\nmug,test\n", "expected path, and"),
        ("path;split\na.obj;test\n", "separated by commas"),
        ("path,split\na.obj\n", "line 2: 2 fields are expected"),
        ("path,split\na.obj,test,x\n", "line 2: 2 fields are expected"),
        ("path,split\na.obj,dev\n", "line 2: split 'dev': expected train, validation, test"),
        ("path,split\nb.obj,test\n", "b.obj: no such file or folder: correct the path"),
        ("path,split\n../a.obj,test\n", "not below"),
        ("path,split\na.obj,test\n./a.obj,train\n", "line 3: there is a line for a.obj already"),
        ("path,class,split\n,mug,test\n", "line 2: the path is empty"),
        ("path,up\na.obj,w\n", "line 2: up 'w': expected x, y, z, or nothing"),
        ("path,scale\na.obj,mm\n", "line 2: scale 'mm': expected diagonal, keep, metres a unit"),
        ("path,scale\na.obj,0\n", "line 2: scale '0'"),
        ("path,scale\na.obj,1e99\n", "line 2: scale '1e99'"),
        ("path,exclude\na.obj,perhaps\n", "line 2: exclude 'perhaps': expected yes, no, or nothing"),
    ],
)
def test_mistakes_in_a_table_name_file_line_and_remedy(tmp_path, text, says):
    tree(tmp_path / "meshes", "a.obj")
    tree(tmp_path, "a.obj")
    (tmp_path / "objects.csv").write_text(text)
    with pytest.raises(ConfigError, match=says) as error:
        read_object_table(tmp_path / "objects.csv", tmp_path / "meshes")
    assert str(error.value).startswith(str(tmp_path / "objects.csv"))


def test_a_table_that_is_none(tmp_path):
    with pytest.raises(ConfigError, match="No such file.*set source.objects"):
        read_object_table(tmp_path / "none.csv", tmp_path)
    with pytest.raises(ConfigError, match="/dev/zero: no file, or over 256 MiB: set source.objects to a CSV file"):
        read_object_table("/dev/zero", tmp_path)
    (tmp_path / "utf16.csv").write_text("path,split\n", encoding="utf-16")
    with pytest.raises(ConfigError, match="no CSV file in UTF-8"):
        read_object_table(tmp_path / "utf16.csv", tmp_path)


def test_ycb(tmp_path, caplog):
    """Google's scan where there is one, else the next; other scans are recorded, and folders without any named."""
    for path in ("002_can/google_16k", "002_can/tsdf", "003_box/poisson", "003_box/clouds"):
        painted(tmp_path / path)
        ball().export(tmp_path / path / "nontextured.ply")
    tree(tmp_path, "001_chips/README")
    given = source(tmp_path, "ycb")
    assert all_classes(given) == {"object": "all"}
    entries = scan(given, {"thing": "all"})
    assert [(entry.object, entry.source, entry.others, entry.up) for entry in entries] == [
        ("thing-002_can", "002_can/google_16k/textured.obj", ("002_can/tsdf/textured.obj",), "z"),
        ("thing-003_box", "003_box/poisson/textured.obj", (), "z"),
    ]
    assert "no mesh in 1 models: 001_chips" in caplog.text
    tsdf = scan(replace(given, pattern="*/tsdf/textured.obj"), {"thing": "all"})
    assert [entry.source for entry in tsdf] == ["002_can/tsdf/textured.obj"]


def test_google_scanned_objects(tmp_path):
    """Textures are not beside the mesh. They are found, they are part of the checksum, and they are what is drawn."""
    mesh = painted(tmp_path / "Red_Box" / "meshes", "../materials/textures/texture.png")
    mesh.rename(mesh.with_name("model.obj"))
    tree(tmp_path / "Red_Box", "model.sdf", "metadata.pbtxt", "thumbnails/0.jpg")
    given = source(tmp_path, "google_scanned_objects")
    (entry,) = scan(given, {"toy": "all"})
    assert (entry.object, entry.source) == ("toy-Red_Box", "Red_Box/meshes/model.obj")
    assert companions(tmp_path / entry.source) == ["../materials/textures/texture.png", "textured.mtl"]
    record = prepare(tmp_path / entry.source, tmp_path / "out")
    assert record["source"]["problems"] == {}
    assert images_of(tmp_path / "out/visual.glb") == [(200, 10, 10)]
    # A texture that was copied beside the mesh comes first.
    Image.new("RGB", (4, 4), (10, 10, 200)).save(tmp_path / "Red_Box/meshes/texture.png")
    assert companions(tmp_path / entry.source) == ["texture.png", "textured.mtl"]
    prepare(tmp_path / entry.source, tmp_path / "again")
    assert images_of(tmp_path / "again/visual.glb") == [(10, 10, 200)]


def images_of(path: Path) -> list[tuple[int, int, int]]:
    """The colour of the first pixel of each image in a binary glTF file, read by hand."""
    data = path.read_bytes()
    length = int.from_bytes(data[12:16], "little")
    content, binary = json.loads(data[20 : 20 + length]), data[28 + length :]
    views = [content["bufferViews"][image["bufferView"]] for image in content["images"]]
    starts = [(view.get("byteOffset", 0), view["byteLength"]) for view in views]
    return [Image.open(io.BytesIO(binary[a : a + n])).convert("RGB").getpixel((0, 0)) for a, n in starts]


@pytest.mark.parametrize("above", ["", "hf-objaverse-v1/"])
def test_objaverse(tmp_path, above):
    for folder, uid in (
        ("000-023", "8476c4170df24cf5bbe6967222d1a42d"),
        ("000-110", "ead7bd6c4b2640b58dc1b53f88f9d3d1"),
    ):
        path = tmp_path / f"{above}glbs/{folder}/{uid}.glb"
        path.parent.mkdir(parents=True)
        ball().export(path)
    tree(tmp_path, f"{above}lvis-annotations.json.gz", f"{above}object-paths.json.gz")
    (tmp_path / "objects.csv").write_text(f"path,class\n{above}glbs/000-023,mug\n{above}glbs/000-110,pan\n")
    given = source(tmp_path, "objaverse", objects=tmp_path / "objects.csv")
    entries = scan(given, all_classes(given))
    assert [(entry.class_name, entry.up) for entry in entries] == [("mug", "y"), ("pan", "y")]
    assert names(entries)[0] == "mug-000-023-8476c4170df24cf5bbe6967222d1a42d"


def test_shapenet_of_both_versions_is_one_object(tmp_path):
    tree(tmp_path, "03624134/a/model.obj", "03624134/a/models/model_normalized.obj")
    (entry,) = scan(source(tmp_path, "shapenet"), {"knife": "all"})
    assert entry.source == "03624134/a/model.obj" and entry.others == ("03624134/a/models/model_normalized.obj",)


def test_home_folders(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    section = {"kind": "folder", "path": "~/meshes", "objects": "~/objects.csv"}
    config = {"results": "~/results", "run": "mine", "source": section}
    resolved = Source.from_config(config, "/project")
    assert (resolved.path, resolved.objects) == (f"{tmp_path}/meshes", f"{tmp_path}/objects.csv")
    assert resolved.up == "format"
    procedural = {**config, "source": {"kind": "procedural", "path": None, "up": None}}
    assert Source.from_config(procedural, "/project").path == f"{tmp_path}/results/mine/sources"
    tree(tmp_path, "meshes/mug/a.obj")
    (tmp_path / "objects.csv").write_text("path,split\n~/meshes/mug/a.obj,test\n")
    assert scan(resolved, {"mug": "all"})[0].split == "test"
    with pytest.raises(ConfigError, match="write the path out"):
        Source.from_config({**config, "results": "~nobody-of-this-name/x"}, "/project")


def test_the_table_does_not_depend_on_the_place_of_the_meshes(formats, tmp_path_factory):
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    shutil.copytree(formats / "can", elsewhere / "can")
    assert whole_catalogue(source(formats), {"can": "all"}).equals(whole_catalogue(source(elsewhere), {"can": "all"}))


def test_the_texture_of_a_ply_is_in_its_checksum(tmp_path):
    path = write(tmp_path / "mug/glue", "ply", texture=True)
    before = checksum(path, tmp_path)
    ImageOps.invert(Image.open(tmp_path / "mug/glue/picture.png")).save(tmp_path / "mug/glue/picture.png")
    assert checksum(path, tmp_path) != before


def test_names_do_not_double(tmp_path):
    tree(tmp_path, "bottle/glue_1/glue_1.stl", "bottle/a/b/b.stl", "bottle/bottle.stl", "bottle/c/d/c.stl")
    found = {entry.source: entry.object for entry in scan(source(tmp_path), {"bottle": "all"})}
    assert found == {
        "bottle/glue_1/glue_1.stl": "bottle-glue_1",
        "bottle/a/b/b.stl": "bottle-a-b",
        "bottle/bottle.stl": "bottle",
        "bottle/c/d/c.stl": "bottle-c-d-c",
    }
    tree(tmp_path, "bottle/glue_1.stl")  # has fewer folders: it keeps the name
    found = {entry.source: entry.object for entry in scan(source(tmp_path), {"bottle": "all"})}
    assert found["bottle/glue_1.stl"] == "bottle-glue_1" != found["bottle/glue_1/glue_1.stl"]
    assert len(set(found.values())) == 5


def test_names_are_no_longer_than_a_files_name_may_be(tmp_path):
    deep = "/".join(letter * 120 for letter in "nmo")
    tree(tmp_path, f"mug/{deep}/a.stl", f"mug/{deep}/b.stl")
    found = names(scan(source(tmp_path), {"mug": "all"}))
    assert len(set(found)) == 2 and all(len(name) <= 200 for name in found)


def test_linked_folders_are_followed_and_loops_end(tmp_path):
    tree(tmp_path, "meshes/mug/a.stl", "meshes/mug/in/b.stl", "elsewhere/c.stl", "elsewhere/deep/d.stl")
    mug = tmp_path / "meshes/mug"
    (mug / "linked").symlink_to(tmp_path / "elsewhere")
    (mug / "in/up").symlink_to("..")  # a loop
    (mug / "in/self").symlink_to(".")
    (mug / "whole").symlink_to("/")
    (tmp_path / "elsewhere/back").symlink_to(mug)  # a loop of two
    for pattern in (None, "{class}/**", "{class}/**/*.stl"):
        given = source(tmp_path / "meshes", pattern=pattern)
        found = [entry.source for entry in scan(given, {"mug": "all"})]
        assert found == ["mug/a.stl", "mug/in/b.stl", "mug/linked/c.stl", "mug/linked/deep/d.stl"]


def test_a_pattern_with_folders_of_any_depth_within(tmp_path):
    found = "x/a/scan.stl", "x/a/b/c/scan.stl", "x/scan.stl"
    tree(tmp_path, *found, "x/a/other.stl", "y/a/scan.stl", "x/.h/a/scan.stl")
    for pattern, files in (("x/**/a*/scan.stl", {"x/a/scan.stl"}), ("?/**/scan.stl", {*found, "y/a/scan.stl"})):
        entries = scan(source(tmp_path, pattern=pattern), {"mug": "all"})
        assert {entry.source for entry in entries} == files


def test_a_file_whose_name_is_not_utf8_is_an_object_that_can_be_rejected(tmp_path):
    tree(tmp_path, "mug/a.stl")
    with open(os.fsencode(tmp_path) + b"/mug/caf\xe9.stl", "wb"):
        pass
    entries = scan(source(tmp_path), {"mug": "all"})
    assert len({entry.object for entry in entries}) == 2
    (bad,) = (entry for entry in entries if entry.source != "mug/a.stl")
    bad.source.encode()
    assert checksum(tmp_path / bad.source) == ""
    with pytest.raises(UnusableObject, match="not UTF-8"):
        prepare(tmp_path / bad.source, tmp_path / "out")


def copies_of(entries, shapes=None):
    return copies({entry.object: entry.checksum for entry in entries}, shapes)


def rows_of(*rows):
    """Entries by name, given split and checksum."""
    return [CatalogueEntry(name, "mug", split, "batch-0000", checksum=digest) for name, split, digest in rows]


def test_copies_are_in_the_split_of_the_first():
    """Of a hundred names that would be in all splits."""
    names = [f"mug-{number}" for number in range(100)]
    entries = rows_of(*((name, "", "1") for name in names), ("mug-x", "", ""), ("mug-y", "", "2"))
    assert copies_of(entries) == [names]
    splits = splits_of(entries, PAPER_SPLIT, groups=copies_of(entries))
    assert {splits[name] for name in names} == {splits["mug-0"]}
    assert len({assign_split(name) for name in names}) == 3


def test_copies_follow_the_one_whose_split_is_given():
    """And two with different splits of the user's stay where they are."""
    entries = rows_of(("a", "", "1"), ("b", "test", "1"), ("c", "", "1"), ("d", "", "2"), ("e", "train", "2"))
    splits = splits_of(entries, PAPER_SPLIT, groups=copies_of(entries))
    assert splits == {"a": "test", "b": "test", "c": "test", "d": "train", "e": "train"}
    entries = rows_of(("a", "", "1"), ("b", "test", "1"), ("c", "train", "1"))
    splits = splits_of(entries, PAPER_SPLIT, groups=copies_of(entries))
    assert splits == {"a": "test", "b": "test", "c": "train"}


def test_what_looks_alike_is_a_copy():
    """By box, in any order of its sides, and area; copies by checksum and by shape are one group. Also of very many."""
    entries = rows_of(("a", "", "1"), ("b", "", "2"), ("c", "", "1"), ("d", "", "3"), ("e", "", "4"))
    shapes = {"b": [0.5, 0.4, 0.3, 1], "c": [0.3, 0.5, 0.40005, 1], "d": [0.5, 0.4, 0.301, 1]}
    assert copies_of(entries, shapes) == [["a", "b", "c"]]
    many = {str(number): [0.5, 0.4, 0.3, 1 + 1e-6 * (number % 7)] for number in range(500)}
    many |= {"other": [0.5, 0.4, 0.3, 1.1]}
    assert [len(group) for group in copies(dict.fromkeys(many, ""), many)] == [500]


def test_the_checksum_of_a_copy_does_not_depend_on_names(tmp_path):
    """Of an OBJ with its material and texture, copied whole into folders of other names, and under another name."""
    for folder in ("a", "b", "c"):
        painted(tmp_path / folder)
    (tmp_path / "c/textured.obj").rename(tmp_path / "c/other.obj")
    digests = {checksum(tmp_path / f"{file}.obj") for file in ("a/textured", "b/textured", "c/other")}
    assert len(digests) == 1
    Image.new("RGB", (4, 4), (10, 10, 200)).save(tmp_path / "b/texture.png")
    assert checksum(tmp_path / "b/textured.obj") not in digests


@pytest.mark.parametrize(
    ("files", "taken"),
    [
        ("mug/1/textured.obj mug/1/collision.obj mug/1/visual.ply", ["mug/1/textured.obj"]),
        ("mug/1/nontextured.stl mug/1/textured.obj mug/2/model.obj", ["mug/1/textured.obj", "mug/2/model.obj"]),
        ("mug/a.obj mug/a_collision.obj mug/a_vhacd.obj mug/a_low.stl mug/b.obj", ["mug/a.obj", "mug/b.obj"]),
        ("mug/a.stl mug/a_textured.obj mug/aCollision_01.obj mug/aCollision_02.obj", ["mug/a_textured.obj"]),
        ("mug/visual/a.dae mug/collision/a.stl mug/visual/b.dae", ["mug/visual/a.dae", "mug/visual/b.dae"]),
        ("mug/1/red.obj mug/1/collision.obj mug/1/hull_2.stl", ["mug/1/red.obj"]),
        ("mug/a_lod0.obj mug/a_lod1.obj mug/a_lod2.obj", ["mug/a_lod0.obj"]),
        ("mug/a_low.obj mug/a_high.obj mug/model_1.obj mug/model_2.obj", 4),
        ("mug/boat_hull.obj mug/boat_mast.obj mug/lens_convex.obj mug/lens_concave.obj", 4),
    ],
)
def test_files_that_show_one_object_are_one_object(tmp_path, files, taken):
    """Its textured file is taken, and a collision hull last."""
    tree(tmp_path, *files.split())
    entries = scan(source(tmp_path), {"mug": "all"})
    assert len(entries) == taken if isinstance(taken, int) else [entry.source for entry in entries] == taken
    assert sorted(file for entry in entries for file in (entry.source, *entry.others)) == sorted(files.split())


def test_general_names_of_files_are_not_in_names_of_objects(tmp_path):
    """But where the folder has other objects, or a name would be there twice."""
    tree(tmp_path, "mug/003_can/textured.obj", "mug/a/meshes/model.obj", "mug/b/model.obj", "mug/b/other.obj")
    tree(tmp_path, "mug/c/model.obj", "mug/c.obj", "mug/textured.obj")
    found = {entry.source: entry.object for entry in scan(source(tmp_path), {"mug": "all"})}
    assert found == {
        "mug/003_can/textured.obj": "mug-003_can",
        "mug/a/meshes/model.obj": "mug-a",
        "mug/b/model.obj": "mug-b-model",
        "mug/b/other.obj": "mug-b-other",
        "mug/c.obj": "mug-c",
        "mug/c/model.obj": "mug-c-model",
        "mug/textured.obj": "mug-textured",
    }


@pytest.mark.parametrize("name", ["Škoda café", "चम्मच", "чашка", "マグカップ", "ถ้วย"])
@pytest.mark.parametrize("form", ["NFC", "NFD"])
def test_letters_of_other_scripts_are_kept(tmp_path, name, form):
    """Folders and files as macOS writes them are those of the same names."""
    written = unicodedata.normalize(form, name)
    tree(tmp_path, f"{written}/{written} 1.obj", "mug/a.obj")
    given, name = source(tmp_path), unicodedata.normalize("NFC", name)
    assert set(all_classes(given)) == {name, "mug"}
    for asked in (name, unicodedata.normalize("NFD", name)):
        classes = class_counts({"classes": [{"class": asked, "objects": 1}]}, given)
        (entry,) = scan(given, classes)
        safe = name.replace(" ", "_")
        assert entry.class_name == name and entry.object.startswith(f"{safe}-{safe}_1")
        assert (tmp_path / entry.source).is_file()
    schemas = [yaml.safe_load(path.read_text()) for path in Path("workflow/schemas").glob("c*.schema.yaml")]
    assert all(re.search(pattern, asked) for pattern in patterns_of_classes(schemas))
    (tmp_path / "objects.csv").write_text(f"path,split\n{unicodedata.normalize('NFC', written)},test\n")
    assert scan(replace(given, objects=tmp_path / "objects.csv"), classes)[0].split == "test"


def test_a_table_says_up_axis_and_scale_and_what_is_left_out(tmp_path):
    """By object and by class, field by field; a file that is left out gives its place to another of its object."""
    tree(tmp_path, "a/1.obj", "a/2.obj", "a/2.stl", "a/3.obj", "b/4.glb", "c/5.obj", "c/deep/6.obj")
    (tmp_path / "objects.csv").write_text(
        "path,up,scale,exclude\na,x,0.001,\na/1.obj,,keep,no\na/2.obj,,,yes\na/3.obj,,,X\nb,,diagonal,\nc,,,TRUE\n"
    )
    given = source(tmp_path, objects=tmp_path / "objects.csv", scale=0.01)
    assert all_classes(given) == {"a": "all", "b": "all"}
    entries = scan(given, {"a": "all", "b": "all"})
    assert [(entry.source, entry.up, entry.scale) for entry in entries] == [
        ("a/1.obj", "x", "keep"),
        ("a/2.stl", "x", 0.001),
        ("b/4.glb", "y", "diagonal"),
    ]
    with pytest.raises(CatalogueError, match="no mesh found for class c"):
        scan(given, {"c": "all"})
    (tmp_path / "objects.csv").write_text("path,exclude\nc,yes\nc/deep,no\n")
    assert [entry.source for entry in scan(given, {"c": "all"})] == ["c/deep/6.obj"]


def test_files_that_are_not_read_are_named(tmp_path):
    case = Path("tests/cases/unread-formats-silent")
    lines = unread_lines(source(case))
    for said in ("1 STEP file passed over (parts/part.step): ", "1 FBX", "1 USD", "1 VRML"):
        assert any(said in line for line in lines), lines
    tree(tmp_path, *(f"mug/{number}.STP" for number in range(5)), "mug/.git/a.stp", "mug/a.obj")
    (line,) = unread_lines(source(tmp_path))
    assert line.startswith("5 STEP files passed over (mug/0.STP, mug/1.STP, mug/2.STP, ...): ")
    assert unread_lines(Source("procedural", "")) == []


def test_splits_of_few_objects_are_filled(tmp_path):
    """Names alone leave one empty; with a split of the user's, or of no share, they decide as before."""
    for count in (3, 4, 6, 9):
        tree(tmp_path, *(f"mug/{i}.stl" for i in range(count)))
        entries = scan(source(tmp_path), {"mug": "all"})
        assert set(splits_of(entries, {"train": 10_000, "validation": 1, "test": 1}).values()) == set(SPLITS)
        assert set(splits_of(entries, {"train": 1, "validation": 0, "test": 0}).values()) == {"train"}
        given = [entries[0]._replace(split="train"), *entries[1:]]
        assert set(splits_of(given, {"train": 10_000, "validation": 1, "test": 1}).values()) == {"train"}


@pytest.mark.parametrize("count", [1, 2, 3])
def test_of_few_objects_some_are_to_train(tmp_path, count):
    """Whatever their names are; also if the user puts one of them into another split, and if some are copies."""
    for number in range(20):
        tree(tmp_path / str(number), *(f"mug/{number}-{i}.stl" for i in range(count)))
        entries = scan(source(tmp_path / str(number)), {"mug": "all"})
        splits = splits_of(entries, PAPER_SPLIT)
        assert set(splits.values()) == set(SPLITS[:count])
        groups = [[entry.object for entry in entries]] if count > 1 else []
        assert set(splits_of(entries, PAPER_SPLIT, groups=groups).values()) == {"train"}
        if count > 1:
            given = [entries[0]._replace(split="test"), *entries[1:]]
            assert "train" in splits_of(given, PAPER_SPLIT).values()
