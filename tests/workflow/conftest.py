"""Runs of the real workflow on a small folder of meshes, in a temporary results folder."""

import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple
from unittest import mock

import pytest
import snakemake.cli
import trimesh
import yaml

from snakemake_logger_plugin_palpate import INTERRUPTED
from workflow.run import hooks, lock

PROJECT = Path(__file__).parents[2]
# One grasp and a small image an object.
SMALL = {
    "surface": {"points": 500},
    "grasps": {"per_object": 1, "attempts": 1},
    "vision": {"size": 32, "samples": 1, "device": "cpu"},
}
EVERY_SPLIT = {"train": 39, "validation": 31, "test": 30}  # each has some of the two classes' objects


@contextlib.contextmanager
def captured():
    """What is printed meanwhile, by this process and by those that it starts: two files, of each stream."""
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        kept = os.dup(1), os.dup(2)
        try:
            os.dup2(out.fileno(), 1)
            os.dup2(err.fileno(), 2)
            with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
                yield out, err
        finally:
            for number, descriptor in enumerate(kept, start=1):
                os.dup2(descriptor, number)
                os.close(descriptor)


def run_snakemake(
    project: Path, *arguments: str, cores: int = 2, python_path: str = "", object_pages: bool = False
) -> subprocess.CompletedProcess:
    """Snakemake's command in this process: it saves the start of a Python and its imports. Jobs are processes anyway.

    python_path: further places for the jobs' Python to look in. object_pages: whether the run's end writes those of its
    objects, too, which take longer than many a job.
    """
    command = ["snakemake", "--snakefile", str(project / "Snakefile"), "--cores", str(cores), *arguments]
    environment = {"PYTHONPATH": f"{python_path}:{project}"} if python_path else {}
    write_page = hooks._write_page
    handlers = {each: signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)}
    with (
        mock.patch.dict(os.environ, environment),
        mock.patch("sys.argv", command),
        mock.patch.object(lock, "_held", []) as held,
        mock.patch.object(hooks, "_write_page", lambda run, most, *rest: write_page(run, object_pages * most, *rest)),
        contextlib.chdir(project),
        captured() as streams,
    ):
        try:
            snakemake.cli.main(command[1:])
            code = 0
        except SystemExit as end:
            code = int(end.code or 0)
        finally:
            for file in held:  # as at the end of a process
                file.close()
            for each, handler in handlers.items():
                signal.signal(each, handler)
        printed = []
        for stream in streams:
            stream.flush()
            stream.seek(0)
            printed.append(stream.read())
    if INTERRUPTED in printed[1]:  # the run took a Ctrl-C that is for the tests
        raise KeyboardInterrupt
    return subprocess.CompletedProcess(command, code, *printed)


class Job(NamedTuple):
    """A job of a dry run."""

    rule: str
    inputs: list[str]
    outputs: list[str]
    reason: str


@dataclass(frozen=True)
class Workflow:
    """Snakemake on the project's Snakefile, with a config of its own."""

    config: Path
    run: Path
    python_path: str = ""  # further places for Python to look in

    def command(self, *arguments: str) -> list[str]:
        """For a process of its own."""
        snakemake = [sys.executable, "-m", "snakemake", "--snakefile", str(PROJECT / "Snakefile")]
        return [*snakemake, "--cores", "2", *arguments, "--configfile", str(self.config)]

    def __call__(self, *arguments: str, **options) -> subprocess.CompletedProcess:
        """options: as of `run_snakemake`."""
        settings = *arguments, "--configfile", str(self.config)
        return run_snakemake(PROJECT, *settings, python_path=self.python_path, **options)

    def jobs(self, *targets: str) -> list[Job]:
        """The jobs that a dry run would run."""
        result = self(*targets, "--dry-run")
        assert result.returncode == 0, result.stdout + result.stderr
        found = []
        for text in re.split(r"^(?:local)?rule ", result.stdout, flags=re.MULTILINE)[1:]:
            fields = dict(re.findall(r"^    (input|output|reason): (.*)", text, re.MULTILINE))
            files = [[path for path in fields.get(key, "").split(", ") if path] for key in ("input", "output")]
            found.append(Job(text.partition(":")[0], *files, fields.get("reason", "")))
        return found

    def planned(self, *targets: str) -> set[str]:
        """The rules that a dry run would run, without those that are named as a file is."""
        return {job.rule for job in self.jobs(*targets) if "/" not in job.rule}

    def outputs(self, *targets: str) -> set[str]:
        """The files that a dry run would make."""
        return {path for job in self.jobs(*targets) for path in job.outputs}

    def changed(self, **config) -> "Workflow":
        """The same run with other values for some keys of its config."""
        path = self.config.with_name("changed.yaml")
        path.write_text(yaml.safe_dump(yaml.safe_load(self.config.read_text()) | config, sort_keys=False))
        return Workflow(path, self.run)

    def copied(self, folder: Path, **config) -> "Workflow":
        """A copy of the run in a folder, with other values for some keys of its config."""
        settings = yaml.safe_load(self.config.read_text()) | {"results": str(folder)} | config
        (folder / "config.yaml").write_text(yaml.safe_dump(settings, sort_keys=False))
        return Workflow(folder / "config.yaml", shutil.copytree(self.run, folder / self.run.name))

    def kill_when(self, path: str, *arguments: str) -> None:
        """Start the workflow and kill it, with every process that it started, as soon as `path` exists."""
        process = subprocess.Popen(
            self.command(*arguments),
            cwd=PROJECT,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        try:
            while not (self.run / path).exists():
                assert process.poll() is None, f"the workflow ended before it wrote {path}"
                try:
                    process.wait(0.02)
                except subprocess.TimeoutExpired:
                    continue
        finally:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def two_classes(root: Path) -> Path:
    """A folder of meshes as a user has it: two classes, three formats, one file that isn't a mesh's."""
    for name in ("can", "brick"):
        (root / name / "nested").mkdir(parents=True)
    trimesh.creation.cylinder(radius=0.03, height=0.2, sections=64).export(root / "can/tall.stl")
    trimesh.creation.cylinder(radius=0.05, height=0.1, sections=64).export(root / "can/nested/flat.ply")
    trimesh.creation.box((20, 60, 120)).export(root / "brick/millimetres.obj")
    (root / "brick/nested/broken.glb").write_bytes(b"this is no mesh")
    return root


@pytest.fixture(scope="session")
def make_workflow(tmp_path_factory):
    """A workflow on the two classes with a results folder of its own; keyword arguments are config keys."""
    meshes = two_classes(tmp_path_factory.mktemp("meshes"))

    def make(**config) -> Workflow:
        folder = tmp_path_factory.mktemp("workflow")
        settings = {
            "run": "run",
            "results": str(folder),
            "source": {"kind": "folder", "path": str(meshes)},
            "classes": "all",
            "vision": {"size": 64, "samples": 2, "device": "cpu"},
            **config,
        }
        path = folder / "config.yaml"
        path.write_text(yaml.safe_dump(settings, sort_keys=False))
        return Workflow(path, folder / "run")

    return make


@pytest.fixture(scope="session")
def finished(make_workflow):
    """A dataset that has been built whole."""
    workflow = make_workflow(split=EVERY_SPLIT)
    result = workflow("dataset", "validate", object_pages=True)
    assert result.returncode == 0, result.stderr
    return workflow


VIEWS = {"count": 3, "size": 48, "samples": 1}
PRESSES = {"count": 2, "forces": [1, 3], "tilt": 0.1, "slide": 1e-4}


@pytest.fixture(scope="session")
def extended(finished, tmp_path_factory):
    """A copy of it, with views and presses."""
    workflow = finished.copied(tmp_path_factory.mktemp("extended"), views=VIEWS, press=PRESSES)
    result = workflow("views/batch-0000.zarr", "press/batch-0000.zarr", "tables/presses.csv")
    assert result.returncode == 0, result.stderr
    return workflow


@pytest.fixture(scope="session")
def one_by_one(make_workflow):
    """The cans alone, on one core, a batch each; views of the first."""
    cans = [{"class": "can", "objects": "all"}]
    workflow = make_workflow(batch_size=1, classes=cans, views=VIEWS | {"count": 2})
    # The tables need every store, and no figure.
    result = workflow("catalogue.csv", "rejected.csv", "views/batch-0000.zarr", cores=1)
    assert result.returncode == 0, result.stderr
    return workflow
