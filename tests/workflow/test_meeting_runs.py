"""Runs that meet in one folder: at the same time, one after another, and after one was killed."""

import dataclasses
import os
import re
import shlex
import socket
import subprocess
import time

import pandas as pd
import pytest
import trimesh
import yaml

import palpate
from palpate.store import StoreError
from tests.workflow.conftest import PROJECT, run_snakemake, two_classes

MESHES = "meshes/batch-0000"
# Python runs a sitecustomize when it starts: a job waits at its first object until a file tells it to go on.
PATIENCE = """
import time
from pathlib import Path
import palpate.batch
from palpate.batch import each_object


def patient(objects, function, stage):
    Path({reached!r}).touch()
    while not Path({go!r}).exists():
        time.sleep(0.05)
    return each_object(objects, function, stage)


palpate.batch.each_object = patient
"""


@pytest.fixture
def first(make_workflow, tmp_path):
    """A run in the background whose only job works until `go` exists: workflow, process and `go`."""
    workflow, reached, go = make_workflow(), tmp_path / "reached", tmp_path / "go"
    (tmp_path / "sitecustomize.py").write_text(PATIENCE.format(reached=str(reached), go=str(go)))
    environment = os.environ | {"PYTHONPATH": f"{tmp_path}:{PROJECT}"}
    streams = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    process = subprocess.Popen(workflow.command(MESHES), cwd=PROJECT, env=environment, **streams)
    while not reached.exists():
        assert process.poll() is None, "the workflow ended before its job began"
        time.sleep(0.05)
    yield workflow, process, go
    go.touch()
    process.wait(300)


def test_a_second_run_in_a_folder_is_refused_and_the_first_goes_on(first):
    workflow, process, go = first
    second = workflow(MESHES)
    assert second.returncode != 0
    assert f"in use by another run: process {process.pid} on {socket.gethostname()}" in second.stderr
    assert "Traceback" not in second.stderr and "WorkflowError" not in second.stderr
    assert workflow(MESHES, "--dry-run").returncode == 0  # to look is allowed
    go.touch()
    assert process.wait(300) == 0 and (workflow.run / MESHES).exists()


def test_after_a_kill_of_the_run_alone_the_next_waits_for_its_jobs_and_sweeps(first):
    workflow, process, go = first
    process.kill()
    process.wait()
    stale = workflow.run / "meshes/.partial-elsewhere~1~0f-batch-0000"
    stale.mkdir(parents=True)
    with subprocess.Popen(workflow.command(MESHES), cwd=PROJECT, stderr=subprocess.PIPE, text=True) as second:
        said = next(line for line in second.stderr if "waiting for jobs of a run that was killed" in line)
        assert re.search(rf"process \d+ on {socket.gethostname()}", said)
        assert not (workflow.run / MESHES).exists()
        go.touch()
        rest = second.stderr.read()
    assert second.returncode == 0, rest
    assert (workflow.run / MESHES).exists() and not list(workflow.run.rglob(".partial-*"))


def test_the_resolved_config_stands_in_the_run_and_starts_it_again(finished, make_workflow):
    path = finished.run / "config.yaml"
    recorded = yaml.safe_load(path.read_text())
    default = yaml.safe_load((PROJECT / "config/config.yaml").read_text())["source"]
    assert recorded["source"] == default | yaml.safe_load(finished.config.read_text())["source"]
    assert recorded["grasps"]["per_object"] == 5  # a default
    assert type(finished)(path, finished.run).planned("dataset") == set()


def test_the_remedy_for_a_missing_stage_makes_it_as_it_stands(finished):
    with pytest.raises(StoreError, match="has no views; build it with: snakemake ") as error:
        palpate.Dataset(finished.run).array("views", "image")[:]
    words = shlex.split(str(error.value).partition("build it with: snakemake ")[2])
    result = run_snakemake(PROJECT, *words, "--dry-run")
    assert result.returncode == 0, result.stdout
    assert "rule views:" in result.stdout and "rule meshes:" not in result.stdout  # of this run, whose meshes are there


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"source": {"kind": "folder", "path": "other"}}, r"source.path: \S+ there, \S+/other in this config"),
        ({"source": {"kind": "procedural"}, "classes": [{"class": "bottle", "objects": 1}]}, "source.kind: folder th"),
        ({"seed": 1}, "seed: 0 there, 1 in this config"),
        ({"classes": [{"class": "can", "objects": "all"}]}, "classes: brick there, not in this config"),
    ],
    ids=["path", "kind", "seed", "classes"],
)
def test_another_run_does_not_write_over_the_one_that_is_there(finished, tmp_path, change, said):
    if "path" in change.get("source", {}):
        change["source"]["path"] = str(two_classes(tmp_path / "other"))
    before = (finished.run / "config.yaml").read_text()
    result = finished.changed(**change)("dataset")
    assert result.returncode != 0
    assert re.search(said, result.stderr), result.stderr
    assert f"{finished.run} holds another run" in result.stderr
    assert f"--configfile {finished.run}/config.yaml" in result.stderr and "--config run=<name>" in result.stderr
    assert (finished.run / "config.yaml").read_text() == before
    assert finished.planned("dataset") == set()
    elsewhere = finished.changed(run="another", **change)  # the way out that is named
    assert elsewhere("catalogue.csv", "--dry-run").returncode == 0


def test_one_more_or_one_less_mesh_makes_one_batch_again(make_workflow, tmp_path):
    for name in "bcd":
        (tmp_path / "mug").mkdir(exist_ok=True)
        trimesh.creation.box((1, 2, 3)).export(tmp_path / f"mug/{name}.stl")
    workflow = make_workflow(source={"kind": "folder", "path": str(tmp_path)}, batch_size=2)
    batches = [f"meshes/batch-000{number}" for number in range(2)]
    result = workflow("catalogue.csv", *batches)
    assert result.returncode == 0, result.stderr

    def again(*targets):
        return sorted(job.outputs[0] for job in workflow.jobs(*targets) if job.rule == "meshes")

    assert again(*batches) == []
    (tmp_path / "mug/c.stl").rename(tmp_path / "c.stl")
    assert again(*batches) == batches[:1]
    (tmp_path / "c.stl").rename(tmp_path / "mug/c.stl")
    for name in ("a", "g"):  # before all others by name, and after
        trimesh.creation.box((1, 2, 3)).export(tmp_path / f"mug/{name}.stl")
    assert again(*batches, "meshes/batch-0002") == [batches[1], "meshes/batch-0002"]
    result = workflow("catalogue.csv", *batches, "meshes/batch-0002")
    assert result.returncode == 0, result.stderr
    assert again(*batches, "meshes/batch-0002") == []
    table = pd.read_csv(workflow.run / "catalogue.csv")
    assert "".join(table["object"].str.removeprefix("mug-")) == "bcadg"
    assert list(table["batch"].str[-1].astype(int)) == [0, 0, 1, 1, 2]


def test_the_end_of_a_run_is_a_summary_and_its_output_is_quiet(make_workflow, tmp_path):
    """Of a run in which an object is rejected and a job fails: its reason, its log, and no page a job."""
    (tmp_path / "sitecustomize.py").write_text(FULL)
    workflow = make_workflow(batch_size=2)
    result = dataclasses.replace(workflow, python_path=str(tmp_path))("rejected/meshes/batch-0000.csv", *SURFACES)
    said = result.stderr
    assert result.returncode != 0
    log = workflow.run / "logs/surface/batch-0001.log"
    assert f"failed: surface surface/batch-0001.zarr: {workflow.run}: the disk is full: free some space" in said
    assert f"(log: {log})" in said and "7 jobs done, 1 failed, in " in said
    for page in ("jobid:", "resources:", "Traceback", "RuleException", "wildcards:"):
        assert page not in said, said
    assert "No space left on device" in log.read_text() and "Traceback" in log.read_text()
    page = (workflow.run / "index.html").read_text()
    assert f"{workflow.run}/index.html" in said or f"{workflow.run}: index.html" in said
    assert "1 job failed" in page and "the disk is full" in page and 'href="logs/surface/batch-0001.log"' in page
    result = workflow("rejected/meshes/batch-0000.csv", *SURFACES, "catalogue.csv")
    assert result.returncode == 0 and "objects: 4, used 3 (" in result.stderr
    assert "failed" not in (workflow.run / "index.html").read_text().partition("<main>")[0].partition("<body>")[2]
    assert "  1 at meshes: can't be read as .glb" in result.stderr
    pages = workflow("tables/dataset_statistics.csv", "--printshellcmds", "--dry-run").stdout
    assert "jobid:" in pages


SURFACES = ["surface/batch-0000.zarr", "surface/batch-0001.zarr"]
FULL = """
import palpate.batch
from palpate.batch import each_object


def full(objects, function, stage):
    if stage == "surface" and "can-tall" in list(objects):
        raise OSError(28, "No space left on device")
    return each_object(objects, function, stage)


palpate.batch.each_object = full
"""
