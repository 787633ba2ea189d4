"""Commands that the docs name: modules answer --help, examples and profiles say what they need."""

import re
import runpy
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

PROJECT = Path(__file__).parents[1]
FILES = (
    "README.md",
    "CONTRIBUTING.md",
    "Makefile",
    "docs/**/*.md",
    "config/*.md",
    "palpate/**/*.py",
    "studies/**/*.py",
)
DOCS = [path for files in FILES for path in PROJECT.glob(files)]
MODULES = sorted(
    {
        name
        for path in DOCS
        for name in re.findall(r"python3? -m ((?:palpate|studies)(?:\.\w+)+)(?![\w<]|\.[\w<])", path.read_text())
    }
)


@pytest.mark.parametrize("module", MODULES)
def test_every_module_that_the_docs_name_answers_help(module, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [module, "--help"])
    with pytest.raises(SystemExit) as end:
        runpy.run_module(module, run_name="__main__", alter_sys=True)
    said = capsys.readouterr().out
    assert end.value.code in (0, None) and said.startswith("usage: ") and said.count("\n") > 3, said


@pytest.mark.parametrize("name", ["train_on_a_run", "reconstruct_a_grasp", "compare_sensors"])
def test_an_example_without_its_run_names_the_command_that_makes_it(name, tmp_path):
    command = [sys.executable, PROJECT / f"examples/{name}.py", "results/nope"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, env={"PYTHONPATH": str(PROJECT)})
    assert done.returncode == 1
    assert done.stderr == "results/nope is not a run's folder; the smoke run is made with: snakemake --cores 2 smoke\n"


@pytest.mark.skipif(bool(find_spec("snakemake_executor_plugin_slurm")), reason="the plugin is installed")
def test_the_slurm_profile_without_its_plugin_is_one_line():
    command = [sys.executable, "-m", "snakemake", "--workflow-profile", "profiles/slurm", "all"]
    done = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True)
    *_, last = done.stderr.splitlines()
    assert done.returncode == 1 and last.endswith("which is not installed here; install it with: make slurm")
    assert "usage" not in done.stderr and "Traceback" not in done.stderr
