"""Sources through the Snakefile: layouts, names, places, and the files that meshes name."""

import os
import shutil

import numpy as np
import pandas as pd
import pytest
import trimesh
from PIL import Image

from tests.workflow.conftest import PROJECT, SMALL

STAGES = {"catalogue", "meshes", "surface", "grasps", "touch", "vision"}


def write_box(path):
    path.parent.mkdir(parents=True, exist_ok=True)
    trimesh.creation.box((1, 2, 3)).export(path)


def write_textured(folder):
    """A box with a texture as OBJ and as glTF with its buffers and its image beside it."""
    folder.mkdir(parents=True)
    box = trimesh.creation.box((1, 2, 3))
    image = Image.new("RGB", (4, 4), (200, 10, 10))
    box.visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(box.vertices), 2)), image=image)
    box.export(folder / "a b.obj", mtl_name="paint.mtl")
    for name, content in trimesh.exchange.gltf.export_gltf(trimesh.Scene(box)).items():
        (folder / name).write_bytes(content)


def catalogued(workflow, file="catalogue.csv"):
    """A table of the catalogue; that of a batch needs no meshes, and has no splits."""
    result = workflow(file)
    assert result.returncode == 0, result.stderr
    return pd.read_csv(workflow.run / file)


@pytest.mark.parametrize("classes", ["all", [{"class": "coffee-mug", "objects": 1}]])
def test_a_class_may_have_any_name_that_is_safe_in_a_path(make_workflow, tmp_path, classes):
    for name in ("coffee-mug", "_v1.2"):
        write_box(tmp_path / name / "a.stl")
    workflow = make_workflow(source={"kind": "folder", "path": str(tmp_path)}, classes=classes)
    file, expected = "catalogue.csv", ["_v1.2", "coffee-mug"]
    if classes != "all":
        file, expected = "catalogue/batch-0000.csv", ["coffee-mug"]
    assert list(catalogued(workflow, file)["class"]) == expected
    assert "figures/examples_coffee-mug.png" in workflow.outputs("dataset")


@pytest.mark.parametrize(
    ("file", "said"),
    [
        ("coffee<mug>/a.stl", "class 'coffee<mug>': use letters, digits"),
        (
            "mug/b{1}.stl",
            "mug/b{1}.stl: Snakemake takes {...} and <...> in a path for placeholders: rename it",
        ),
        ("mug/<results>/b.stl", "mug/<results>/b.stl: Snakemake takes {...} and <...> in a path"),
    ],
)
def test_a_name_that_cannot_be_used_is_one_message(make_workflow, tmp_path, file, said):
    write_box(tmp_path / file)
    result = make_workflow(source={"kind": "folder", "path": str(tmp_path)})("all")
    assert result.returncode != 0
    assert said in result.stderr
    assert "Traceback" not in result.stderr


def test_odd_names_that_can_be_used_are_used(make_workflow, tmp_path):
    for name in ("b{", "{}", "{a b}", "*", "[x]", "$HOME", "'q", '"q', "~", " "):
        write_box(tmp_path / "mug" / f"{name}.stl")
    workflow = make_workflow(source={"kind": "folder", "path": str(tmp_path)})
    assert len(catalogued(workflow)) == 10


def test_names_with_html_are_text_in_snakemakes_report(make_workflow, tmp_path):
    name = "<img src=x onerror=alert(1)>"
    write_box(tmp_path / "meshes/salt & pepper's" / f"{name}.stl")
    (tmp_path / "meshes/salt & pepper's" / f"bad {name}.stl").write_text(name)
    workflow = make_workflow(source={"kind": "folder", "path": str(tmp_path / "meshes")}, classes="all", **SMALL)
    made = workflow("tables/grasp_success.csv", "rejected/meshes/batch-0000.csv")
    assert made.returncode == 0, made.stderr
    assert name in (workflow.run / "rejected/meshes/batch-0000.csv").read_text()
    result = workflow("tables/grasp_success.csv", "--report", "report.html")
    assert result.returncode == 0, result.stderr
    report = (workflow.run / "report.html").read_text()
    assert "grasp_success" in report and "<img src=x" not in report


@pytest.mark.parametrize("model", ["model.obj", "models/model_normalized.obj"])
def test_shapenet_in_the_layout_of_either_version(make_workflow, tmp_path, model):
    for synset, name in {"02876657": "1a", "03624134": "2b", "99999999": "3c"}.items():
        write_box(tmp_path / synset / name / model)
    workflow = make_workflow(source={"kind": "shapenet", "path": str(tmp_path)})
    table = catalogued(workflow, "catalogue/batch-0000.csv")
    assert list(table["class"]) == ["bottle", "knife", "99999999"]
    assert list(table["object"]) == ["bottle-1a", "knife-2b", "99999999-3c"]
    assert table["source"][0] == f"02876657/1a/{model}"
    assert workflow.planned("dataset") >= STAGES - {"catalogue", "meshes"}
    only = workflow.changed(classes=[{"class": "knife", "objects": 1}], run="only")
    (job,) = [job for job in only.jobs("meshes/batch-0000") if job.rule == "catalogue_batch"]
    assert str(tmp_path / "03624134/2b" / model) in job.inputs and len(job.inputs) == 1


def test_objects_as_a_user_has_them(make_workflow, tmp_path):
    """YCB's layout, a table of classes and splits, and sizes that are kept: catalogue, meshes, other configs."""
    for name, size in (("002_can", 0.1), ("025_mug", 0.12), ("055_ball", 75)):
        folder = tmp_path / "ycb" / name / "google_16k"
        folder.mkdir(parents=True)
        trimesh.creation.box((size, size, size)).export(folder / "textured.obj")
        trimesh.creation.box((1, 1, 1)).export(folder / "nontextured.stl")
    table = tmp_path / "objects.csv"
    table.write_text("path,class,split\n002_can,tin can,train\n025_mug,tin can,test\n055_ball,ball,train\n")
    source = {"kind": "ycb", "path": str(tmp_path / "ycb"), "scale": "keep", "objects": str(table)}
    workflow = make_workflow(source=source)
    assert "figures/examples_tin_can.png" in workflow.outputs("dataset")
    result = workflow("meshes/batch-0000", "catalogue.csv")
    assert result.returncode == 0, result.stderr
    rows = pd.read_csv(workflow.run / "catalogue.csv")
    assert list(rows["class"]) == ["ball", "tin can", "tin can"] and list(rows["split"]) == ["train", "train", "test"]
    (rejected,) = pd.read_csv(workflow.run / "rejected/meshes/batch-0000.csv").itertuples()
    assert rejected.object == "ball-055_ball" and "0.001 or 0.01 would fit), in the config's source" in rejected.reason
    mug = trimesh.load_mesh(workflow.run / "meshes/batch-0000/tin_can-025_mug/visual.glb")
    np.testing.assert_allclose(mug.extents, 0.12, rtol=1e-6)
    # Another split does not touch the meshes, and another scale is another run.
    table.write_text(table.read_text().replace("test", "validation"))
    assert workflow.planned("meshes/batch-0000", "catalogue.csv") == {"catalogue"}
    refused = workflow.changed(source=source | {"scale": "diagonal"})("meshes/batch-0000")
    assert refused.returncode != 0 and "source.scale: keep there, diagonal in this config" in refused.stderr
    table.write_text("path,split\n002_can,dev\n")
    assert f"{table}, line 2: split 'dev': expected train" in workflow("catalogue.csv").stderr


def test_abc_in_its_layout(make_workflow, tmp_path):
    for number in range(3):
        write_box(tmp_path / f"0000000{number}" / f"0000000{number}_abc_trimesh_000.obj")
    source = {"kind": "abc", "path": str(tmp_path)}
    workflow = make_workflow(source=source, classes=[{"class": "part", "objects": "all"}])
    table = catalogued(workflow, "catalogue/batch-0000.csv")
    assert list(table["class"]) == ["part"] * 3
    assert table["source"][2] == "00000002/00000002_abc_trimesh_000.obj"
    assert workflow.planned("dataset") >= STAGES - {"catalogue", "meshes"}
    assert len(make_workflow(source=source).jobs("meshes/batch-0000")[0].inputs) == 3


def test_a_relative_path_is_the_projects(make_workflow, tmp_path):
    write_box(tmp_path / "mug/a.stl")
    path = os.path.relpath(tmp_path, PROJECT)
    workflow = make_workflow(source={"kind": "folder", "path": path})
    result = workflow("meshes/batch-0000")
    assert result.returncode == 0, result.stderr
    assert (workflow.run / "meshes/batch-0000/mug-a/visual.glb").exists()


def test_a_change_to_a_file_that_a_mesh_names_runs_its_batch_again(make_workflow, tmp_path):
    write_textured(tmp_path / "mug")
    workflow = make_workflow(source={"kind": "folder", "path": str(tmp_path)}, batch_size=1)
    targets = ["catalogue.csv", "meshes/batch-0000", "meshes/batch-0001"]
    result = workflow(*targets)
    assert result.returncode == 0, result.stderr
    (texture,) = (path for path in (tmp_path / "mug").glob("*.png"))
    for changed, mesh in {
        texture: "a b.obj",
        tmp_path / "mug/paint.mtl": "a b.obj",
        next((tmp_path / "mug").glob("*.bin")): "model.gltf",
    }.items():
        content = changed.read_bytes()
        changed.write_bytes(content + b"\n")
        _, catalogue_batch, meshes = jobs = sorted(job for job in workflow.jobs(*targets) if job.outputs)
        assert [job.rule for job in jobs] == ["catalogue", "catalogue_batch", "meshes"]
        assert "Params have changed" in catalogue_batch.reason
        assert f"Input files updated by another job: {catalogue_batch.outputs[0]}" in meshes.reason
        assert catalogue_batch.inputs[0] == str(tmp_path / "mug" / mesh)
        changed.write_bytes(content)
    assert workflow.planned(*targets) == set()  # later, but the same again


def test_a_file_that_is_replaced_by_an_older_one_runs_its_batch_again(make_workflow, tmp_path):
    """As `cp -p` and unzip do. A copy with another time, and a link in its place, are the same."""
    write_box(tmp_path / "meshes/mug/a.stl")
    trimesh.creation.box((1, 2, 4)).export(tmp_path / "older.stl")
    os.utime(tmp_path / "older.stl", (1e9, 1e9))
    workflow = make_workflow(source={"kind": "folder", "path": str(tmp_path / "meshes")})
    targets = "catalogue.csv", "meshes/batch-0000"
    assert workflow(*targets).returncode == 0
    before = (workflow.run / "catalogue.csv").read_text()
    source = tmp_path / "meshes/mug/a.stl"
    source.rename(tmp_path / "kept.stl")
    source.symlink_to(tmp_path / "kept.stl")
    os.utime(source, (2e9, 2e9))
    assert workflow.planned(*targets) == set()
    source.unlink()
    shutil.copy2(tmp_path / "older.stl", source)
    assert workflow.planned(*targets) == {"catalogue", "catalogue_batch", "meshes"}
    assert workflow(*targets).returncode == 0
    assert (workflow.run / "catalogue.csv").read_text() != before
    assert workflow.planned(*targets) == set()
    shutil.copy2(tmp_path / "kept.stl", source)
    os.utime(source, (1, 1))
    assert workflow.planned(*targets) == {"catalogue", "catalogue_batch", "meshes"}


def test_copies_and_near_copies_are_in_one_split(make_workflow, tmp_path):
    """Textured OBJs that are the same byte for byte, and the shape in another format and another folder, y up."""
    for number in range(12):
        write_textured(tmp_path / f"mug/{number}")
        for name in ("model.gltf", "gltf_buffer_0.bin", "material_0.png"):
            (tmp_path / f"mug/{number}/{name}").unlink(missing_ok=True)
        trimesh.creation.box((1, 2, 3 + number / 10)).export(tmp_path / f"mug/other-{number}.stl")
    (tmp_path / "mug/11/a b.obj").rename(tmp_path / "mug/11/else.obj")
    trimesh.creation.box((1, 3, 2)).export(tmp_path / "mug/y_up.ply")
    split = {"train": 1, "validation": 1, "test": 1}
    table = catalogued(make_workflow(source={"kind": "folder", "path": str(tmp_path)}, split=split))
    boxes = table[~table.object.str.contains("other-") | (table.object == "mug-other-0")]
    assert len(boxes) == 14 and boxes.split.nunique() == 1 and boxes.checksum.nunique() == 3
    assert table.split.nunique() == 3
