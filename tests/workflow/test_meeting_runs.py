"""Runs that meet in one folder: at the same time, one after another, and after one was killed."""

import os
import re
import signal
import socket
import subprocess

import pytest
import yaml

from tests.workflow.conftest import PROJECT, two_classes

MESHES = "meshes/batch-0000"


def start(workflow, *arguments):
    """The workflow in the background, once a job of it runs."""
    process = subprocess.Popen(
        workflow.command(*arguments), cwd=PROJECT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        start_new_session=True,
    )  # fmt: skip
    while not (workflow.run / f"logs/{MESHES}.log").exists():
        assert process.poll() is None, "the workflow ended before its first job began"
    return process


def test_a_second_run_in_a_folder_is_refused_and_the_first_goes_on(make_workflow):
    workflow = make_workflow()
    first = start(workflow, MESHES)
    second = workflow(MESHES)
    assert second.returncode != 0
    assert f"in use by another run: process {first.pid} on {socket.gethostname()}" in second.stderr
    assert "Traceback" not in second.stderr and "WorkflowError" not in second.stderr
    assert workflow.plan(MESHES, "--dry-run").returncode == 0  # to look is allowed
    assert first.wait(300) == 0 and (workflow.run / MESHES).exists()


def test_after_a_kill_of_the_run_alone_the_next_waits_for_its_jobs_and_sweeps(make_workflow):
    workflow = make_workflow()
    first = start(workflow, MESHES)
    os.kill(first.pid, signal.SIGKILL)
    first.wait()
    stale = workflow.run / "meshes/.partial-elsewhere~1~0f-batch-0000"
    stale.mkdir(parents=True)
    second = workflow(MESHES)
    assert second.returncode == 0, second.stderr
    assert "waiting for jobs of a run that was killed: process" in second.stderr
    assert (workflow.run / MESHES).exists() and not list(workflow.run.rglob(".partial-*"))


def test_the_resolved_config_stands_in_the_run_and_starts_it_again(finished, make_workflow):
    path = finished.run / "config.yaml"
    recorded = yaml.safe_load(path.read_text())
    assert recorded["source"] == {"kind": "folder", "up": None} | yaml.safe_load(finished.config.read_text())["source"]
    assert recorded["grasps"]["per_object"] == 5  # a default
    assert type(finished)(path, finished.run).planned("dataset") == set()


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
    assert elsewhere.plan("catalogue.csv", "--dry-run").returncode == 0
