"""What a source holds: every layout in a small tree, stable choices and names, and clear errors."""

import re
from pathlib import Path

import pytest
import yaml

from palpate import mesh, shapes
from palpate.catalogue import CatalogueError, Source, class_counts, scan, sources
from palpate.catalogue.source import MESH_SUFFIXES, UP_AXIS
from palpate.catalogue.sources import all_classes
from palpate.configuration import ConfigError


def tree(root, *files):
    for file in files:
        path = root / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"{file}\n")
    return root


def names(entries):
    return [entry.object for entry in entries]


def test_what_is_repeated_here_agrees_with_its_origin():
    assert {suffix[1:] for suffix in MESH_SUFFIXES} == set(mesh.FORMATS)
    assert set(UP_AXIS.values()) <= {"x", "y", "z", "format"}
    schemas = [yaml.safe_load(path.read_text()) for path in Path("workflow/schemas").glob("c*.schema.yaml")]
    assert sorted(patterns_of_classes(schemas)) == [f"^{sources.CLASS_NAME}$"]


def patterns_of_classes(schema):
    if isinstance(schema, list):
        return [pattern for each in schema for pattern in patterns_of_classes(each)]
    if not isinstance(schema, dict):
        return []
    own = [schema["class"]["pattern"]] if isinstance(schema.get("class"), dict) else []
    return own + patterns_of_classes(list(schema.values()))


def test_procedural_needs_no_files(tmp_path):
    entries = scan(Source("procedural", tmp_path / "none"), {"rifle": 1, "bottle": 3})
    assert [(entry.object, entry.class_name, entry.source) for entry in entries] == [
        ("rifle-0000", "rifle", "rifle/rifle-0000.glb"),
        ("bottle-0000", "bottle", "bottle/bottle-0000.glb"),
        ("bottle-0001", "bottle", "bottle/bottle-0001.glb"),
        ("bottle-0002", "bottle", "bottle/bottle-0002.obj"),
    ]


def test_procedural_files_are_where_the_catalogue_looks(tmp_path):
    (entry,) = scan(Source("procedural", tmp_path), {"cellphone": 1})
    (tmp_path / "cellphone").mkdir()
    assert shapes.write("cellphone", 0, tmp_path / "cellphone" / entry.object) == tmp_path / entry.source


def test_folder(tmp_path):
    """Every format, upper case too, nested; not textures, hidden files, or other classes."""
    tree(
        tmp_path,
        *(f"mug/{suffix[1:]}{suffix}" for suffix in MESH_SUFFIXES),
        "mug/deep/er/a.STL",
        "mug/ply.mtl",
        "mug/texture.png",
        "mug/._obj.obj",
        "mug/.cache/x.obj",
        "other/b.obj",
    )
    entries = scan(Source("folder", tmp_path), {"mug": "all"})
    assert names(entries) == sorted([f"mug-{suffix[1:]}" for suffix in MESH_SUFFIXES] + ["mug-deep-er-a"])
    assert all((tmp_path / entry.source).is_file() for entry in entries)


@pytest.mark.parametrize("file", ["model.obj", "models/model_normalized.obj"])
def test_shapenet(tmp_path, file, caplog):
    """Both versions; a model without a mesh is left out, and said so."""
    tree(tmp_path, *(f"03624134/{model}/{file}" for model in ("b2", "a1")), "03624134/c3/models/notes.txt")
    tree(tmp_path, f"02880940/d4/{file}")
    entries = scan(Source("shapenet", tmp_path), {"knife": 2, "02880940": "all"})
    assert [(entry.object, entry.source) for entry in entries] == [
        ("knife-a1", f"03624134/a1/{file}"),
        ("knife-b2", f"03624134/b2/{file}"),
        ("02880940-d4", f"02880940/d4/{file}"),
    ]
    assert "c3" in caplog.text
    assert all_classes(Source("shapenet", tmp_path)) == {"02880940": "all", "knife": "all"}


def test_abc(tmp_path):
    tree(tmp_path, "00000002.obj", "00000001.stl", "readme.txt")
    entries = scan(Source("abc", tmp_path), {"part": "all"})
    assert [entry[:3] for entry in entries] == [
        ("part-00000001", "part", "00000001.stl"),
        ("part-00000002", "part", "00000002.obj"),
    ]
    assert all_classes(Source("abc", tmp_path)) == {"object": "all"}


def test_the_choice_of_objects_is_even_and_stable(tmp_path):
    """Some of 200: not simply the first, always the same, and more when more are asked for."""
    tree(tmp_path, *(f"mug/{i:03d}.obj" for i in range(200)))
    source = Source("folder", tmp_path)
    ten, fifty = scan(source, {"mug": 10}), scan(source, {"mug": 50})
    assert ten == scan(source, {"mug": 10})
    assert set(ten) < set(fifty)
    assert names(fifty) == sorted(names(fifty))
    assert 20 <= sum(int(name[4:]) < 100 for name in names(fifty)) <= 30
    tree(tmp_path, "mug/new.obj")
    assert len(set(fifty) - set(scan(source, {"mug": 50}))) <= 1


def test_object_names_are_safe_and_differ(tmp_path):
    tree(tmp_path, "mug/a b.obj", "mug/a_b.obj", "mug/a?b.obj", "mug/杯子.obj", "mug/瓶子.obj", "mug/-x.obj")
    found = names(scan(Source("folder", tmp_path), {"mug": "all"}))
    assert len(set(found)) == 6
    assert "mug-a_b" in found
    assert all(re.fullmatch(r"mug-[\w.-]+", name) for name in found)
    assert {"mug-杯子", "mug-瓶子"} < set(found)


def test_all_classes(tmp_path):
    tree(tmp_path, "mug/a.obj", "pan/b.obj", ".git/c.obj", "readme.txt")
    assert all_classes(Source("folder", tmp_path)) == {"mug": "all", "pan": "all"}


@pytest.mark.parametrize(
    ("kind", "mesh", "classes"),
    [("folder", "mug/deep/a.obj", ["mug"]), ("shapenet", "03624134/a1/model.obj", ["knife"])],
)
def test_all_classes_leaves_out_folders_without_a_mesh(tmp_path, caplog, kind, mesh, classes):
    tree(tmp_path, mesh, "notes/read.me", "02880940/b2/picture.png", "mug-licences/.hidden.obj")
    source = Source(kind, tmp_path)
    assert list(all_classes(source)) == classes
    assert "02880940" in caplog.text
    assert scan(source, all_classes(source))


def test_class_counts(tmp_path):
    """As listed; the folders of the source for `all`; a class that is listed twice has no count."""
    tree(tmp_path, "mug/a.obj")
    source = Source("folder", tmp_path)
    rows = [{"class": "pan", "objects": 2}, {"class": "mug", "objects": "all"}]
    assert list(class_counts({"classes": rows}, source).items()) == [("pan", 2), ("mug", "all")]
    assert class_counts({"classes": "all"}, source) == {"mug": "all"}
    with pytest.raises(ConfigError, match="config classes: pan listed more than once: keep one"):
        class_counts({"classes": [*rows, {"class": "pan", "objects": 3}]}, source)


@pytest.mark.parametrize(
    ("kind", "classes", "says"),
    [
        ("folder", {"cup": 1}, r"cup: no such folder.*holds|cup: no such folder.*empty, mug"),
        ("folder", {"empty": "all"}, "no mesh"),
        ("folder", {"mug": 3}, "2 meshes of class mug, the config asks for 3.*ask for 2 or `all`"),
        ("folder", {"mug": 0}, "from 1"),
        ("folder", {"mug": "some"}, "`all`, not 'some'"),
        ("folder", {"../mug": 1}, "use letters"),
        ("folder", {"coffee mug": 1, "coffee_mug": 1}, "'coffee mug' and 'coffee_mug' would have files of one name"),
        ("procedural", {"mug": 1}, "bottle, knife, cellphone, rifle"),
        ("procedural", {"bottle": "all"}, "no end"),
        ("shapenet", {"mug": 1}, "synset"),
        ("shapenet", {"bottle": 1}, "02876657: no such folder"),
        ("abc", {"a": 1, "b": 1}, "one class"),
    ],
)
def test_errors_name_the_place_and_the_remedy(tmp_path, kind, classes, says):
    tree(tmp_path, "mug/a.obj", "mug/b.obj", "empty/notes.txt")
    with pytest.raises(CatalogueError, match=says):
        scan(Source(kind, tmp_path), classes)


@pytest.mark.parametrize("kind", ["folder", "shapenet", "abc"])
def test_a_missing_root_is_named(tmp_path, kind):
    with pytest.raises(CatalogueError, match="nowhere: no such folder: set source.path"):
        scan(Source(kind, tmp_path / "nowhere"), {"bottle": 1})


def test_all_classes_needs_folders(tmp_path):
    for kind in ("folder", "shapenet", "abc", "procedural"):
        with pytest.raises(CatalogueError):
            all_classes(Source(kind, tmp_path))
