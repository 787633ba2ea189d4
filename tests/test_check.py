"""`palpate check`: what a run would work on, and one object of it through every stage."""

import shutil

import numpy as np
import pytest
import trimesh
import yaml
from PIL import Image
from snakemake.settings.types import ConfigSettings
from snakemake.utils import update_config

from palpate import grasp, hand, mesh, surface, touch
from palpate.batch import generator
from palpate.check import DEFAULT, MOST_OPENED, make_example, resolve
from palpate.command import main
from palpate.configuration import merge, read_config
from palpate.scene import GRASP_ARRAYS, Scene
from palpate.sensor import DIGIT
from tests.hand import grippers
from tests.workflow.conftest import PROJECT, run_snakemake, two_classes

SMALL = {"vision": {"size": 48, "samples": 1, "device": "cpu"}, "surface": {"points": 1000}}


@pytest.fixture
def folder(tmp_path):
    """Two classes: an STL, an OBJ whose texture is missing, one that is no mesh, one in millimetres."""
    meshes = two_classes(tmp_path / "meshes")
    box = trimesh.creation.box((0.05, 0.06, 0.12))
    uv = np.zeros((len(box.vertices), 2))
    box.visual = trimesh.visual.TextureVisuals(uv=uv, image=Image.new("RGB", (4, 4), "red"))
    box.export(meshes / "brick/red.obj")
    (picture,) = (meshes / "brick").glob("*.png")
    picture.unlink()
    return meshes


@pytest.fixture
def overlay(folder, tmp_path):
    def write(**keys):
        path = tmp_path / "mine.yaml"
        source = {"kind": "folder", "path": str(folder)}
        path.write_text(
            yaml.safe_dump({"run": "mine", "results": str(tmp_path), "source": source, "classes": "all"} | keys)
        )
        return path

    return write


VALUES = (None, 1, "text", [1, 2], {}, {"a": 1}, {"a": {"b": 2}}, {"a": None})


@pytest.mark.parametrize("below", VALUES, ids=str)
@pytest.mark.parametrize("value", VALUES, ids=str)
def test_configs_are_merged_as_snakemake_merges_them(below, value):
    ours, theirs = ({"key": dict(below) if isinstance(below, dict) else below, "other": 1} for _ in range(2))
    update_config(theirs, {"key": value, "new": value})
    assert merge(ours, {"key": value, "new": value}) == theirs


def test_several_overlays_are_read_as_snakemake_reads_them(tmp_path):
    texts = (
        "source: null\nclasses: all\n",
        "source: {path: ~/x, scale: 1e-3}\nvision: {size: 64}\n",
        "vision: {samples: 2}\n",
    )
    paths = [tmp_path / f"{number}.yaml" for number in range(len(texts))]
    for path, text in zip(paths, texts, strict=True):
        path.write_text(text)
    expected = yaml.safe_load((PROJECT / DEFAULT).read_text())
    update_config(expected, ConfigSettings(configfiles=paths).overwrite_config)
    assert read_config(PROJECT / DEFAULT, paths) == expected


def test_it_says_what_there_is_and_what_is_wrong(overlay, folder, tmp_path, capsys):
    config = overlay(**SMALL)
    assert main(["check", str(config)]) == 0
    said = capsys.readouterr()
    assert said.err == ""
    for line in (
        "5 objects in 2 classes: .glb 1, .obj 2, .ply 1, .stl 1",
        "z is taken: if objects lie, set source.up to y",
        "opened 5 meshes, of which ",
        "0.143 to 136 units of the file across, 12 to ",
        ".png: there is no such file: drawn in neutral grey",
        "brick-nested-broken can't be used: ",
        "hand: allegro, 16 joints; sensors index, middle, ring, thumb: digit, 25 mm deep",
        "  thumb, mm out of the surface of its link: sensor plane -19, gel's face +0, end of range +6",
        f"--configfile {config}",
    ):
        assert line in said.out, said.out
    assert "  brick: " in said.out and "  can: " in said.out
    assert said.out.count("through every stage:\n") == said.out.count("  grasp after") == 2  # one of each class
    with Image.open(tmp_path / "mine/check.png") as picture:
        assert picture.format == "PNG" and len(picture.convert("RGB").getcolors(10**7)) > 1000
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["check.png"]
    planned = run_snakemake(PROJECT, "dataset", "--dry-run", "--configfile", str(config))  # the run is as new
    assert planned.returncode == 0, planned.stderr


def test_the_object_that_is_asked_for_is_taken_and_shown_where_asked(overlay, tmp_path, capsys):
    config = overlay(**SMALL)
    assert main(["check", str(config), "--output", str(tmp_path / "one.png"), "--object", "brick-millimetres"]) == 0
    said = capsys.readouterr().out
    assert said.count("through every stage:\n") == said.count("brick-millimetres, through every stage:\n") == 1
    assert "  grasp after" in said and (tmp_path / "one.png").exists() and not (tmp_path / "mine").exists()
    assert main(["check", str(config), "--object", "can-tal"]) == 1
    assert "no object 'can-tal' in this run; its objects are" in capsys.readouterr().err


@pytest.fixture
def meshes_only(monkeypatch):
    """Without an example."""
    monkeypatch.setattr("palpate.check.make_example", lambda *_: {})


def test_sizes_that_are_kept_come_with_a_hint_at_the_unit(overlay, folder, meshes_only, capsys):
    shutil.rmtree(folder / "can")
    source = {"kind": "folder", "path": str(folder), "scale": "keep", "up": "z"}
    assert main(["check", str(overlay(**SMALL, source=source))]) == 0
    said = capsys.readouterr().out
    assert "if objects lie" not in said  # the config says how they stand
    assert "brick-millimetres can't be used: at scale keep it is 136 m across" in said and "here 0.001 or" in said


def test_the_example_is_the_runs_own_first_grasp(overlay, tmp_path):
    """Readings and image of one object are those that the stages make for the run, one by one."""
    config = read_config(PROJECT / DEFAULT, [overlay(**SMALL)])
    settings, robot = resolve(config, PROJECT), hand.allegro()
    (entry,) = (each for each in settings.entries if each.object == "can-tall")
    root = tmp_path / "meshes"
    pictures = make_example(entry, root, config, settings.sensor, robot, tmp_path)

    mesh.prepare(root / entry.source, tmp_path / "again", up="z", collision_faces=4000)
    visual = mesh.load_visual(tmp_path / "again")
    points = surface.sample(visual, 1000, generator(0, entry.object, "surface")) + mesh.OBJECT_POSITION
    rng = generator(0, entry.object, "grasps")
    found = grasp.grasp_object(visual, mesh.load_collision(tmp_path / "again"), points, robot, rng, max_attempts=60)
    made = Scene.from_grasps(tmp_path / "again", {key: getattr(found, key) for key in GRASP_ARRAYS}, robot)
    sensed = touch.sense_scene(made, touch.scene_tracer(made, DIGIT))
    readings = np.where(sensed.success[..., None, None, None], sensed.reading, touch.empty_reading(DIGIT))
    assert list(pictures)[:2] == ["image", "in the hand"]
    shown = np.stack(list(pictures.values())[2:])
    assert any(np.array_equal(shown, each) for each in readings)
    assert pictures["image"].shape == (48, 48, 3)


def test_of_many_meshes_some_of_each_class_are_opened(overlay, folder, meshes_only, capsys):
    for number in range(40):
        shutil.copy(folder / "can/tall.stl", folder / f"can/{number}.stl")
    assert main(["check", str(overlay(**SMALL))]) == 0
    said = capsys.readouterr().out
    assert f"opened {MOST_OPENED} of 45 meshes" in said and "brick-nested-broken can't be used" in said


def test_copies_are_said_with_their_split_and_the_pattern_that_takes_one(overlay, folder, meshes_only, capsys):
    """Byte for byte, by their shape, and files of one object; a hull is no example, and its object is named."""
    shutil.copy(folder / "can/tall.stl", folder / "can/same.stl")
    trimesh.creation.box((1, 1, 1)).export(folder / "brick/millimetres_collision.stl")
    trimesh.creation.box((1, 1, 9)).export(folder / "can/nested/1_vhacd.stl")
    trimesh.creation.box((1, 1, 8)).export(folder / "can/nested/2_vhacd.stl")
    assert main(["check", str(overlay(**SMALL))]) == 0
    said = capsys.readouterr().out
    for line in (
        "  1 further files of the same objects are not used, the first is taken: "
        "brick/millimetres.obj = brick/millimetres_collision.stl\n",
        "  1 object is there several times, in one split (= the same files, ~ the same shape): can-same = can-tall\n",
        "a line `can/tall.stl,yes` of source.objects (path,exclude) leaves a file out",
        "2 objects have a collision mesh only, by its name (can-nested-1_vhacd, can-nested-2_vhacd)",
    ):
        assert line in said, said
    assert "vhacd, through every stage" not in said
    trimesh.load_mesh(folder / "can/tall.stl").export(folder / "brick/can.obj")
    assert main(["check", str(overlay(**SMALL))]) == 0
    said = capsys.readouterr().out
    assert "~ the same shape): brick-can ~ can-same ~ can-tall\n" in said
    assert '`source: {pattern: "{class}/**/*.obj"}` takes such files alone' in said


def test_what_is_no_mesh_is_named(overlay, meshes_only, capsys):
    """Formats that are not read, and files that are something else by their content; a class that has no other."""
    for case, expected in {
        "unread-formats-silent": ("no class: parts", "STEP", "(parts/part.step)", "FBX", "USD", "VRML"),
        "wrong-formats": ("2 x a Git LFS pointer", "an HTML page", "STEP by its content", "(wrong-formats/page.stl)"),
    }.items():
        source = {"kind": "folder", "path": str(PROJECT / "tests/cases" / case)}
        classes = "all"
        if case == "wrong-formats":
            source |= {"path": str(PROJECT / "tests/cases")}
            classes = [{"class": case, "objects": "all"}]
        assert main(["check", str(overlay(**SMALL, source=source, classes=classes))]) == 0
        said = capsys.readouterr().out
        assert all(each in said for each in expected), said


def test_what_the_run_rejects_is_not_usable(overlay, folder, meshes_only, capsys):
    """Coordinates that are no numbers, no area, far from the origin: as the meshes stage says."""
    box = trimesh.creation.box((1, 1, 1))
    changed = {
        "nan": np.where(np.arange(8)[:, None] == 0, np.nan, box.vertices),
        "flat": box.vertices * [1, 0, 0],
        "far": box.vertices * 1.1 + [123456.7, 0, 0],
    }
    for name, vertices in changed.items():
        trimesh.Trimesh(vertices, box.faces, process=False).export(folder / f"can/{name}.ply")
    assert main(["check", str(overlay(**SMALL))]) == 0
    said = capsys.readouterr().out
    assert "can-nan can't be used: 1 of 8 vertices are not finite" in said
    assert "can-flat can't be used: " in said and "has an area" in said
    assert "can-far can't be used: " in said and "rounded" in said


def test_procedural_objects_can_be_looked_at(overlay, capsys):
    keys = {"source": {"kind": "procedural"}, "classes": [{"class": "knife", "objects": 4}]}
    assert main(["check", str(overlay(**SMALL, **keys))]) == 0
    said = capsys.readouterr().out
    assert "source: procedural, made by Palpate\n4 objects in 1 class:" in said and "in the hand" not in said


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"sede": 1}, "sede: unknown key; did you mean 'seed'?"),
        (
            {"source": {"path": "~/meshes"}},
            "source.path: '~/meshes': procedural objects have no folder: add source.kind",
        ),
        ({"source": {"kind": "folder"}}, "source.path: None: set it to the folder of the meshes"),
        ({"classes": "thing"}, "classes: 'thing': expected all, or a list as [{class: mug, objects: all}]"),
        ({"vision": {"background": "white"}}, "'white': expected transparent, or sRGB from 0 to 1: white is [1, 1, 1]"),
        ({"grasps": {"per_object": 10}}, "config grasps: attempts must be at least per_object"),
        ({"grasps": {"hand": {"mjcf": "no.xml", "sensors": "no.yaml"}}}, "no.xml: no such file"),
        ({"touch": {"sensor": "digits"}}, "digits: no such file; sensors by name are digit"),
        ({"vision": {"lights": [{"kind": "sun", "energy": 1}]}}, "light of kind sun needs a position"),
        ({"training": {"override": {"nonsense": 1}}}, "nonsense: unknown key"),
        ({"training": {"recipe": "papr"}}, "no recipe 'papr'"),
        ({"tuning": {"grid": "vast"}}, "vast"),
        ({"classes": [{"class": "cup", "objects": 1}]}, "the class cup has its meshes there; "),
    ],
)
def test_errors_are_the_workflows(overlay, keys, said, capsys):
    config = overlay(**keys)
    assert main(["check", str(config)]) == 1
    printed = capsys.readouterr().err
    assert said in printed and "Traceback" not in printed
    planned = run_snakemake(PROJECT, "dataset", "--dry-run", "--configfile", str(config))
    assert printed.strip() in planned.stdout + planned.stderr


def test_a_mistake_in_the_files_of_a_hand_or_sensor_is_the_workflows_message(overlay, tmp_path, capsys):
    files = {"mjcf": tmp_path / "hand.xml", "sensors": tmp_path / "sensors.yaml"}
    files["mjcf"].write_text(grippers.two_fingers("degree"))
    files["sensors"].write_text(yaml.safe_dump(grippers.SENSORS | {"open": {"no_such_joint": 0.1}}))
    (tmp_path / "gel.yaml").write_text("name: gel\nwidht: 0.02\n")
    hand = {"grasps": {"hand": {key: str(path) for key, path in files.items()}}}
    for keys, said in ((hand, "no_such_joint"), ({"touch": {"sensor": str(tmp_path / "gel.yaml")}}, "widht")):
        config = overlay(**keys)
        assert main(["check", str(config)]) == 1
        printed = capsys.readouterr().err
        planned = run_snakemake(PROJECT, "dataset", "--dry-run", "--configfile", str(config))
        assert said in printed and printed.strip() in planned.stdout + planned.stderr


@pytest.mark.parametrize(
    ("text", "said"),
    [("run: [", "can't be read as YAML"), ("- 1", "expected keys of a config"), (None, "no such file")],
)
def test_a_config_that_is_none_is_one_line(tmp_path, text, said, capsys):
    if text:
        (tmp_path / "mine.yaml").write_text(text)
    assert main(["check", str(tmp_path / "mine.yaml")]) == 1
    printed = capsys.readouterr().err
    assert said in printed and printed.startswith(str(tmp_path / "mine.yaml")) and printed.count("\n") == 1


def test_it_runs_where_the_workflow_is(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("palpate.check.__file__", str(tmp_path / "site-packages/palpate/check.py"))
    assert main(["check"]) == 1
    assert "runs with the workflow" in capsys.readouterr().err
