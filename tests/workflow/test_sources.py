"""Sources through the Snakefile: layouts, names, places."""

import pandas as pd
import pytest
import trimesh


def write_box(path):
    path.parent.mkdir(parents=True, exist_ok=True)
    trimesh.creation.box((1, 2, 3)).export(path)


@pytest.mark.parametrize("classes", ["all", [{"class": "coffee-mug", "objects": 1}]])
def test_a_class_may_have_any_name_that_is_safe_in_a_path(make_workflow, tmp_path, classes):
    for name in ("coffee-mug", "_v1.2"):
        write_box(tmp_path / name / "a.stl")
    workflow = make_workflow(source={"kind": "folder", "path": str(tmp_path)}, classes=classes)
    result = workflow("catalogue.csv")
    assert result.returncode == 0, result.stderr
    expected = ["_v1.2", "coffee-mug"] if classes == "all" else ["coffee-mug"]
    assert list(pd.read_csv(workflow.run / "catalogue.csv")["class"]) == expected
    assert "examples" in workflow.planned("figures/examples_coffee-mug.png")


def test_a_class_whose_name_is_not_safe_is_one_message(make_workflow, tmp_path):
    write_box(tmp_path / "coffee mug/a.stl")
    result = make_workflow(source={"kind": "folder", "path": str(tmp_path)})("all")
    assert result.returncode != 0
    assert "class 'coffee mug': use letters, digits" in result.stderr
    assert "Traceback" not in result.stderr
