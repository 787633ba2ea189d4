"""The summary of a run: counts of objects and the commonest reasons, from its tables."""

import csv
import json
import shutil
from pathlib import Path

from palpate import mesh
from palpate.catalogue import COLUMNS
from palpate.dataset import summary
from palpate.dataset.summary import kind_of_reason


def test_objects_used_and_rejected_with_the_commonest_reasons(tmp_path):
    splits = ["train"] * 5 + ["validation"] * 2 + ["test"]
    with open(tmp_path / "catalogue.csv", "w", newline="") as file:
        rows = [(f"mug-{i}", "mug", split, "batch-0000", f"{i}.stl", *[""] * 6) for i, split in enumerate(splits)]
        csv.writer(file).writerows([COLUMNS, *rows])
    (tmp_path / "rejected/meshes").mkdir(parents=True)
    (tmp_path / "rejected/grasps").mkdir()
    (tmp_path / "rejected/meshes/batch-0000.csv").write_text(
        "object,stage,reason\nmug-0,meshes,/a/0.stl: no triangles\nmug-5,meshes,/a/5.stl: no triangles\n"
    )
    (tmp_path / "rejected/grasps/batch-0000.csv").write_text(
        "object,stage,reason\nmug-1,grasps,3 of 5 grasps in 60 attempts\n"
        "mug-2,grasps,\"/a/2.stl: '2.0' is no name\"\nmug-3,grasps,\"/a/3.stl: '3.0' is no name\"\n"
    )
    assert summary(tmp_path) == [
        "objects: 8, used 3 (train 1, validation 1, test 1), rejected 5",
        "  2 at grasps: '2.0' is no name (the first; numbers differ)",
        "  2 at meshes: no triangles",
        "  1 at grasps: 3 of 5 grasps in 60 attempts",
    ]


def test_a_run_without_a_catalogue_has_no_summary(tmp_path):
    assert summary(tmp_path) == []


def test_reasons_that_differ_in_place_and_numbers_are_one():
    for path, number in (("/x/a.stl", "1,234"), ("b/c.obj", "7")):
        assert kind_of_reason(f"{path}: {number} vertices of 1e-05: export it") == "N vertices of N: export it"
    assert kind_of_reason("RuntimeError: a/b is bad") == "RuntimeError: a/b is bad"


def run_of(tmp_path, objects, facts, config=""):
    """objects: name, split, checksum."""
    with open(tmp_path / "catalogue.csv", "w", newline="") as file:
        rows = [(name, "mug", split, "batch-0000", "", checksum, *[""] * 5) for name, split, checksum in objects]
        csv.writer(file).writerows([COLUMNS, *rows])
    (tmp_path / "meshes").mkdir(parents=True)
    (tmp_path / f"meshes/batch-0000{mesh.FACTS}").write_text(json.dumps(facts))
    (tmp_path / "config.yaml").write_text(config)
    return summary(tmp_path)[1:]


def test_a_missing_texture_is_said_by_the_objects_name(tmp_path):
    objects = [("mug-a", "train", "1"), ("mug-b", "train", "2")]
    facts = {
        "mug-a": {"problems": {}, "shape": [0.5, 0.5, 0.5, 1]},
        "mug-b": {"problems": {"drill.png": "there is no such file"}, "shape": [0.6, 0.5, 0.5, 1]},
        "mug-gone": {"problems": {"x.png": "there is no such file"}, "shape": [0.6, 0.5, 0.5, 1]},
    }
    assert run_of(tmp_path, objects, facts) == [
        "1 object without a texture that the file names: mug-b (drill.png: there is no such file)"
    ]


def test_copies_and_what_looks_like_one(tmp_path):
    objects = [("mug-a", "train", "1"), ("mug-b", "train", "1"), ("mug-c", "test", "2"), ("mug-d", "train", "3"),
               ("mug-e", "train", ""), ("mug-f", "train", "")]  # fmt: skip
    shape = [0.5, 0.4, 0.3, 1.0]
    facts = {name: {"problems": {}, "shape": shape} for name in ("mug-a", "mug-b")}
    facts["mug-c"] = {"problems": {}, "shape": [length + 4e-5 for length in shape]}
    facts["mug-d"] = {"problems": {}, "shape": [length + 4e-4 for length in shape]}
    facts["mug-e"] = facts["mug-f"] = {"problems": {}, "shape": [0.1, 0.2, 0.9, 1.0]}
    what = "(= the same files, ~ the same shape)"
    assert run_of(tmp_path, objects, facts) == [
        f"1 object is there several times, in one split {what}: mug-e ~ mug-f",
        f"1 object is there several times, IN DIFFERENT SPLITS {what}: mug-a ~ mug-b ~ mug-c",
    ]
    objects[2] = ("mug-c", "train", "2")
    shutil.rmtree(tmp_path / "meshes")
    assert run_of(tmp_path, objects[:4], {}) == [f"1 object is there several times, in one split {what}: mug-a = mug-b"]


def test_files_that_were_passed_over_are_named(tmp_path):
    source = f"{{kind: folder, path: {Path('tests/cases/unread-formats-silent').absolute()}}}"
    lines = run_of(tmp_path, [("a", "train", "1")], {}, f"source: {source}\nresults: results\nrun: x\nclasses: all")
    for said in ("STEP file passed over (parts/part.step)", "FBX", "USD", "VRML"):
        assert any(said in line for line in lines), lines


def test_splits_that_were_filled_are_said(tmp_path):
    objects = [(f"mug-{i}", split, str(i)) for i, split in enumerate(("train", "validation", "test"))]
    (line,) = run_of(tmp_path, objects, {}, "split: {train: 1000000, validation: 1, test: 1}")
    assert line.startswith("splits: names alone leave one empty")
