"""The workflow as a whole, on a folder of meshes: what it builds, what it leaves out, how it resumes."""

import dataclasses
import hashlib
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import palpate
from palpate.mesh import FORMATS
from palpate.rebuild_command import RECORD
from tests.mesh import nasty
from tests.workflow.conftest import EVERY_SPLIT, PROJECT, SMALL, run_snakemake
from workflow.run.lock import JOBS_LOCK, LOCK

STORES = ("surface", "grasps", "touch", "vision")
PAGE = ("index.html", "last_run.json", "viewer")
USABLE = ["brick-millimetres", "can-nested-flat", "can-tall"]


def digests(run: Path) -> dict[str, str]:
    """SHA-256 of every file that a run made, but for records of how it went: times, logs, locks, config."""
    return {
        str(path.relative_to(run)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(run.rglob("*"))
        if path.is_file()
        and not path.name.startswith((".snakemake", ".config.yaml."))
        and path.relative_to(run).parts[0] not in (".snakemake", "logs", "benchmarks", LOCK, JOBS_LOCK, RECORD, *PAGE)
    }


def test_dry_run_on_a_fresh_folder_plans_every_stage(make_workflow):
    jobs = make_workflow(split=EVERY_SPLIT).jobs()  # no target: all
    assert {job.rule for job in jobs} >= {"catalogue", "meshes", *STORES, "validation", "table", "figure"}
    files = {path for job in jobs for path in job.outputs}
    assert files >= {"tables/grasp_success.csv", "tables/claims.md"}
    assert files >= {"figures/data_point.png", "figures/grasp_steps.png"}


def test_a_target_builds_just_what_it_needs(make_workflow):
    workflow = make_workflow()
    assert "vision" not in workflow.planned("tables/grasp_success.csv")
    assert "touch" not in workflow.planned("vision/batch-0000.zarr")
    assert workflow.planned("surface/batch-0000.zarr") == {"catalogue_batch", "catalogue", "meshes", "surface"}


def test_the_run_is_whole_and_valid(finished):
    checks = pd.read_csv(finished.run / "reports/validation.csv")
    assert len(checks) and checks.passed.all()
    dataset = palpate.Dataset(finished.run)
    assert dataset.objects == USABLE
    assert set(dataset.stages) == set(STORES)
    for item in dataset:
        assert len(item.grasps) == 5
        assert all(grasp.success.any() for grasp in item.grasps)
    for figure in ("data_point", "grasp_steps", "examples_can", "examples_brick"):
        assert (finished.run / f"figures/{figure}.png").stat().st_size > 10_000


def test_a_run_ends_with_its_page(finished):
    text = (finished.run / "index.html").read_text()
    for said in (*USABLE, "brick-nested-broken", "nested/broken.glb", "One data point", "data:image/webp"):
        assert said in text
    assert all((finished.run / f"viewer/{name}.html").exists() for name in USABLE)
    assert not finished.jobs("dataset")  # no file of the workflow depends on it


def test_logs_say_what_is_omitted(finished):
    log = (finished.run / "logs/grasps/batch-0000.log").read_text()
    for name in USABLE:
        assert re.search(rf"{name}: omitted: .* visual faces, .* pairs of palm .* pairs of object patches", log)


def test_what_cannot_be_used_is_rejected_with_stage_and_reason(finished):
    rejected = pd.read_csv(finished.run / "rejected.csv")
    assert list(rejected.columns) == ["object", "stage", "reason"]
    assert list(rejected.object) == ["brick-nested-broken"]
    assert list(rejected.stage) == ["meshes"]
    assert "nested/broken.glb" in rejected.reason[0]


# Python runs a sitecustomize when it starts: in every job, before its script.
FAULTS = """
import palpate.batch
from palpate.batch import each_object

FAULTS = {"touch": "brick-millimetres", "vision": "can-tall"}


def failing(objects, function, stage):
    def at_fault(name):
        if FAULTS.get(stage) == name:
            raise RuntimeError(f"{name} is too much for {stage}")
        return function(name)

    return each_object(objects, at_fault, stage)


palpate.batch.each_object = failing
"""


def test_an_object_rejected_after_its_grasps_is_left_out_and_the_rest_is_valid(make_workflow, tmp_path):
    """The one object of its batch and class that is left is rejected at touch; one of two at vision."""
    (tmp_path / "sitecustomize.py").write_text(FAULTS)
    workflow = make_workflow(batch_size=2, **SMALL)
    targets = "validate", "tables/dataset_statistics.csv", "figures/examples_brick.png"
    result = dataclasses.replace(workflow, python_path=str(tmp_path))(*targets)
    assert result.returncode == 0, result.stderr
    rejected = pd.read_csv(workflow.run / "rejected.csv").set_index("object")
    assert rejected.stage.to_dict() == {
        "brick-nested-broken": "meshes",
        "brick-millimetres": "touch",
        "can-tall": "vision",
    }
    assert rejected.reason["can-tall"] == "RuntimeError: can-tall is too much for vision"
    assert palpate.Dataset(workflow.run).objects == ["can-nested-flat"]
    assert palpate.Dataset(workflow.run, stages=["grasps"]).objects == USABLE
    assert palpate.Dataset(workflow.run, stages=["touch"]).objects == USABLE[1:]
    table = pd.read_csv(workflow.run / "tables/dataset_statistics.csv").set_index("class")
    assert table.attempted.to_dict() == {"brick": 2, "can": 2, "total": 4}
    assert table.objects.to_dict() == {"brick": 0, "can": 2, "total": 2}  # images do not count in it
    assert (workflow.run / "figures/examples_brick.png").exists()


def test_a_figure_of_a_class_reads_the_batches_of_that_class(make_workflow):
    workflow = make_workflow(batch_size=2)
    for name, batches in {"brick": {"batch-0000"}, "can": {"batch-0001"}}.items():
        outputs = workflow.outputs(f"figures/examples_{name}.png")
        assert {path for path in outputs if path.startswith("touch/")} == {f"touch/{each}.zarr" for each in batches}


def test_nasty_meshes_go_through_every_stage_or_are_rejected(make_workflow, tmp_path):
    """Nothing crashes or hangs, nothing is lost, and what comes out is valid: no silent garbage."""
    expected = {}
    for name, build in {"usable": nasty.usable, "unusable": nasty.unusable}.items():
        (tmp_path / name).mkdir()
        paths = build(tmp_path / name).values()
        expected[name] = [path for path in paths if path.is_file() and path.suffix[1:] in FORMATS]
    workflow = make_workflow(
        source={"kind": "folder", "path": str(tmp_path)},
        batch_size=100,  # one batch: jobs cost more here than objects do
        **SMALL,
    )
    figures = [f"figures/{name}.png" for name in ("data_point", "examples_usable", "examples_unusable")]
    tables = "tables/dataset_statistics.csv", "tables/grasp_success.csv"
    result = workflow("validate", *tables, *figures, object_pages=True)
    assert result.returncode == 0, result.stderr
    rejected = pd.read_csv(workflow.run / "rejected.csv")
    assert set(rejected.stage) == {"meshes"}
    assert len(rejected) == len(expected["unusable"])
    assert rejected.object.str.startswith("unusable-").all()
    assert len(palpate.Dataset(workflow.run)) == len(expected["usable"])


def test_a_run_in_which_nothing_can_be_used_is_whole_but_not_valid(make_workflow, tmp_path):
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad/page.stl").write_text("no mesh")
    workflow = make_workflow(source={"kind": "folder", "path": str(tmp_path)})
    result = workflow("dataset", "validate")
    assert result.returncode != 0
    assert "none of 1 objects could be used" in result.stderr and "bad/page.stl" in result.stderr
    assert (workflow.run / "tables/grasp_success.csv").exists()
    assert len(palpate.Dataset(workflow.run)) == 0


def test_asking_to_validate_checks_each_time_and_says_what_it_found(finished):
    """It passed when the run was made."""
    values = finished.run / "surface/batch-0000.zarr/points/c"
    values.rename(finished.run / "aside")
    try:
        result = finished("validate")
    finally:
        (finished.run / "aside").rename(values)
    assert result.returncode != 0
    assert re.search(r"\d+ checks, 3 objects: 1 failed", result.stderr)
    advice = r"points/c/0/0/0 is missing; remove \S+ and build it again with: snakemake surface/"
    assert re.search(advice, result.stderr)
    assert re.search(r"\d+ checks, 3 objects: passed", finished("validate").stderr)


def test_nothing_is_left_to_do(finished):
    assert finished.planned("dataset") == set()


def test_a_killed_run_goes_on_and_ends_in_the_same_bytes(finished, make_workflow):
    workflow = make_workflow(split=EVERY_SPLIT)
    targets = ("catalogue.csv", "rejected.csv", "tables/grasp_success.csv", "figures/data_point.png")
    # Between stages, and in the middle of one: its log is there, its store not yet.
    for path in ("meshes/batch-0000", "logs/grasps/batch-0000.log", "logs/vision/batch-0000.log"):
        workflow.kill_when(path, *targets)
    assert not (workflow.run / "vision/batch-0000.zarr").exists()
    result = workflow(*targets)
    assert result.returncode == 0, result.stderr
    found, expected = digests(workflow.run), digests(finished.run)
    assert [path for path in found if found[path] != expected.get(path)] == []
    made = {path for path in expected if path.partition("/")[0] in ("meshes", *STORES)}
    assert {*targets} | made <= {*found}


def test_data_do_not_depend_on_batch_size_or_cores(finished, one_by_one):
    apart, together = palpate.Dataset(one_by_one.run), palpate.Dataset(finished.run).of_class("can")
    assert apart.objects == together.objects == USABLE[1:]
    for store in STORES:
        for name, spec in palpate.store.CONTRACT[store].arrays.items():
            if spec.of_objects and name != "object" and not spec.asked:
                np.testing.assert_array_equal(
                    apart.array(store, name)[:],
                    together.array(store, name)[:],
                    err_msg=f"{store} {name}",
                )


@pytest.mark.parametrize(
    ("config", "said"),
    [
        ({"sede": 1}, "sede: unknown key; did you mean 'seed'?"),
        ({"source": {"kind": "folder", "path": "no/such"}}, "no/such: no such folder"),
        ({"classes": [{"class": "cup", "objects": 1}]}, "the class cup has its meshes there"),
        ({"classes": [{"class": "can", "objects": 9}]}, "2 meshes of class can, the config asks for 9"),
        ({"frames": {"count": 3, "images": 4}}, "frames.images: at most frames.count, 3"),
        ({"frames": {"count": 102}}, "frames.count: at a time step of 0.004 s at most 101"),
        ({"grasps": {"per_object": 10}}, "attempts must be at least per_object"),
        ({"grasps": {"hand": {"mjcf": "no.xml", "sensors": "no.yaml"}}}, "no.xml: no such file"),
    ],
)
def test_a_mistake_in_the_config_is_one_message_before_anything_runs(make_workflow, config, said):
    workflow = make_workflow(**config)
    result = workflow("dataset")
    assert result.returncode != 0
    assert said in result.stderr
    assert "Traceback" not in result.stderr
    assert not (workflow.run / "catalogue.csv").exists()


@pytest.mark.parametrize("option", ["--configfile", "--configfiles"])
def test_a_key_that_stands_twice_in_a_config_file_is_an_error(make_workflow, tmp_path, option):
    workflow = make_workflow()
    (tmp_path / "overlay.yaml").write_text("seed: 1\nrun: run\nseed: 2\n")
    arguments = ["--dry-run", option, str(workflow.config), str(tmp_path / "overlay.yaml"), "--config", "seed=3"]
    result = run_snakemake(PROJECT, "dataset", *arguments)
    assert (
        result.returncode and "overlay.yaml: can't be read as YAML: line 1: key 'seed' stands twice" in result.stdout
    ), result.stdout


def test_smoke_runs_in_a_checkout_whose_path_has_a_space(tmp_path):
    """As far as the nested workflow's check of its config, which fails: no need to build it."""
    checkout = tmp_path / "my check'out"
    checkout.mkdir()
    for name in ("Snakefile", "config"):
        copy = shutil.copytree if (PROJECT / name).is_dir() else shutil.copy
        copy(PROJECT / name, checkout / name)
    for name in ("palpate", "studies", "workflow", "profiles", "envs"):
        (checkout / name).symlink_to(PROJECT / name)
    with open(checkout / "config/smoke.yaml", "a") as file:
        file.write("sede: 1\n")
    command = [sys.executable, "-m", "snakemake", "--cores", "1", "smoke"]
    result = subprocess.run(command, cwd=checkout, capture_output=True, text=True, timeout=600)
    assert result.returncode != 0
    assert "sede: unknown key" in (checkout / "results/default/logs/smoke.log").read_text(), result.stderr
