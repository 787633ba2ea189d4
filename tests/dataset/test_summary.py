"""The summary of a run: counts of objects and the commonest reasons, from its tables."""

import csv

from palpate.catalogue import COLUMNS
from palpate.dataset import summary
from palpate.dataset.summary import kind_of_reason


def test_objects_used_and_rejected_with_the_commonest_reasons(tmp_path):
    splits = ["train"] * 5 + ["validation"] * 2 + ["test"]
    with open(tmp_path / "catalogue.csv", "w", newline="") as file:
        rows = [(f"mug-{i}", "mug", split, "batch-0000", f"{i}.stl", *[""] * 4) for i, split in enumerate(splits)]
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
