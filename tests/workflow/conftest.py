"""Runs of the real workflow on a small folder of meshes, in a temporary results folder."""

import contextlib
import io
import os
import re
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple
from unittest import mock

import pytest
import snakemake.cli
import trimesh
import yaml

PROJECT = Path(__file__).parents[2]
EVERY_SPLIT = {"train": 39, "validation": 31, "test": 30}  # each has some of the two classes' objects


def plan(project: Path, *arguments: str) -> subprocess.CompletedProcess:
    """Snakemake's command in this process, for what starts no job: it saves the start of a Python and its imports."""
    printed, code = (io.StringIO(), io.StringIO()), 0
    streams = contextlib.redirect_stdout(printed[0]), contextlib.redirect_stderr(printed[1])
    command = ["snakemake", "--snakefile", str(project / "Snakefile"), "--cores", "2", *arguments]
    with (
        mock.patch.dict(os.environ),
        mock.patch("sys.argv", command),
        contextlib.chdir(project),
        streams[0],
        streams[1],
    ):
        try:
            snakemake.cli.main(command[1:])
        except SystemExit as end:
            code = int(end.code or 0)
    return subprocess.CompletedProcess(arguments, code, *(text.getvalue() for text in printed))


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

    def command(self, *arguments: str, cores: int = 2) -> list[str]:
        snakemake = [sys.executable, "-m", "snakemake", "--snakefile", str(PROJECT / "Snakefile")]
        return [*snakemake, "--cores", str(cores), *arguments, "--configfile", str(self.config)]

    def __call__(self, *arguments: str, cores: int = 2) -> subprocess.CompletedProcess:
        environment = os.environ | {"PYTHONPATH": f"{self.python_path}:{PROJECT}"}
        return subprocess.run(
            self.command(*arguments, cores=cores),
            cwd=PROJECT,
            env=environment if self.python_path else None,
            capture_output=True,
            text=True,
            timeout=600,
        )

    def plan(self, *arguments: str) -> subprocess.CompletedProcess:
        """What the command prints of a run in which no job starts."""
        return plan(PROJECT, *arguments, "--configfile", str(self.config))

    def jobs(self, *targets: str) -> list[Job]:
        """The jobs that a dry run would run."""
        result = self.plan(*targets, "--dry-run")
        assert result.returncode == 0, result.stdout + result.stderr
        found = []
        for text in re.split(r"^(?:local)?rule ", result.stdout, flags=re.MULTILINE)[1:]:
            fields = dict(re.findall(r"^    (input|output|reason): (.*)", text, re.MULTILINE))
            files = [[path for path in fields.get(key, "").split(", ") if path] for key in ("input", "output")]
            found.append(Job(text.partition(":")[0], *files, fields.get("reason", "")))
        return found

    def planned(self, *targets: str) -> set[str]:
        """The rules that a dry run would run."""
        return {job.rule for job in self.jobs(*targets)}

    def outputs(self, *targets: str) -> set[str]:
        """The files that a dry run would make."""
        return {path for job in self.jobs(*targets) for path in job.outputs}

    def changed(self, **config) -> "Workflow":
        """The same run with other values for some keys of its config."""
        path = self.config.with_name("changed.yaml")
        path.write_text(yaml.safe_dump(yaml.safe_load(self.config.read_text()) | config, sort_keys=False))
        return Workflow(path, self.run)

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
    result = workflow("dataset", "validate")
    assert result.returncode == 0, result.stderr
    return workflow
