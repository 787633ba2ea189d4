"""The core of the package reads, validates, views and exports a run without what the extras bring."""

import importlib.metadata
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import palpate
from tests.core_session import EXTRAS, sums
from tests.store.conftest import *  # noqa: F403

ROOT = Path(palpate.__file__).parents[1]
SESSION = ROOT / "tests/core_session.py"
# Python and numpy of the environments that are tried. numpy 1 has no wheels for Python 3.13. PALPATE_PYTHONS=all tries
# all of them, which takes a minute each; otherwise the first.
OLD, NEW = "numpy<2", "numpy>=2"
ENVIRONMENTS = (("3.12", OLD), ("3.13", NEW), ("3.12", NEW), ("3.11", OLD), ("3.11", NEW))
# Files of requirements, by the extra of the package that they make; "" is the package itself.
REQUIREMENTS = {"": ["core.in"], "factory": ["factory.in"], "models": ["models.in"], "all": ["factory.in", "models.in"]}
ALL = os.environ.get("PALPATE_PYTHONS") == "all"


def session(python, run, out, *options, **environment):
    """What `core_session.py` printed last, and all that it printed."""
    command = [str(python), str(SESSION), str(run), str(out), *options]
    done = subprocess.run(command, capture_output=True, text=True, cwd=out, env={**os.environ, **environment})
    assert done.returncode == 0, done.stdout + done.stderr
    return json.loads(done.stdout.splitlines()[-1]), done.stdout + done.stderr


def require_outputs(out, run):
    """The pages and the export are there, and the page of the object shows its mesh."""
    dataset = palpate.Dataset(run)
    assert (out / "index/index.html").stat().st_size > 10_000
    glb = (out / f"pages/{dataset.objects[0]}.glb").read_bytes()
    assert glb.startswith(b"glTF") and b"object object 0" in glb and b"gel thumb" in glb
    assert sorted((out / "webdataset").rglob("*.tar"))


def require_same(found, expected):
    assert found.keys() == expected.keys()
    for name, values in expected.items():
        assert found[name] == pytest.approx(values, rel=1e-6), name


def test_without_engines(run, tmp_path):
    found, printed = session(sys.executable, run, tmp_path, "--block", PYTHONPATH=str(ROOT))
    require_same(found["sums"], sums(run))
    require_outputs(tmp_path, run)
    assert "not checked: on mesh, collision mesh, picture of mesh: pip install 'palpate[factory]'" in printed


def test_the_blocked_modules_are_those_of_the_extras():
    names = {"bpy": "mathutils", "libigl": "igl", "lightning-fabric": "lightning_fabric"}
    wanted = {re.split("[;=<# ]", line)[0] for line in required("factory.in", "models.in")} - {""}
    assert {names.get(name, name) for name in wanted} | {"bpy", "snakemake"} == set(EXTRAS)


def python_of(version):
    """An interpreter of this version that makes virtual environments; None if the machine has none."""
    pyenv = Path.home().glob(f".pyenv/versions/{version}.*/bin/python")
    for place in (shutil.which(f"python{version}"), *pyenv):
        if place and subprocess.run([place, "-c", "import ensurepip"], capture_output=True).returncode == 0:
            return place
    return None


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    source, folder = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("wheel")
    for name in ("palpate", "envs"):
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md"):
        shutil.copy(ROOT / name, source / name)
    build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation"]
    subprocess.run([*build, "--wheel-dir", folder, source], check=True, capture_output=True)
    return next(folder.glob("*.whl"))


def test_the_package_installs_whole(wheel, tmp_path):
    """A wheel: every file of the package but its caches, the command, the dependencies, one version."""
    shutil.unpack_archive(wheel, tmp_path, "zip")
    files = {path.relative_to(ROOT).as_posix() for path in (ROOT / "palpate").rglob("*") if path.is_file()}
    expected = {name for name in files if "__pycache__" not in name}
    found = {path.relative_to(tmp_path).as_posix() for path in (tmp_path / "palpate").rglob("*") if path.is_file()}
    assert found == expected and "palpate/py.typed" in found and "palpate/viewer/three.LICENSE" in found
    (installed,) = importlib.metadata.distributions(path=[str(tmp_path)])
    assert installed.version == palpate.__version__
    assert [entry.value for entry in installed.entry_points] == ["palpate.command:main"]
    for extra, files in REQUIREMENTS.items():
        needed = {line for line in installed.requires if ("extra" not in line if not extra else f'"{extra}"' in line)}
        assert names(needed) == names(required(*files))


def required(*files):
    """Lines of files of requirements, with those of the files that they include."""
    lines = [line for file in files for line in (ROOT / "envs" / file).read_text().splitlines()]
    return [*lines, *(each for line in lines if line.startswith("-r ") for each in required(line[3:]))]


def names(lines):
    """Names of the packages in lines of requirements."""
    found = (re.match(r"[A-Za-z0-9][A-Za-z0-9_.-]*", line) for line in lines)
    return {match[0].lower().replace("_", "-") for match in found if match}


def test_the_lock_file_has_every_dependency():
    """Also of development: `make lock` makes it from both lists."""
    locked = names((ROOT / "envs/requirements.txt").read_text().splitlines())
    for name in ("requirements.in", "development.in"):
        wanted = names(required(name))
        assert wanted and wanted <= locked
    assert set().union(*(names(required(*files)) for files in REQUIREMENTS.values())) <= locked


@pytest.mark.parametrize(("version", "numpy"), ENVIRONMENTS if ALL else ENVIRONMENTS[:1])
def test_in_a_bare_environment(run, wheel, tmp_path, version, numpy):
    if not (python := python_of(version)):
        pytest.skip(f"no Python {version} here")
    subprocess.run([python, "-m", "venv", "--without-pip", tmp_path / "venv"], check=True)
    python = tmp_path / "venv/bin/python"
    install = [sys.executable, "-m", "pip", "--python", python, "install", "--quiet", "--no-compile", "--retries", "1"]
    done = subprocess.run([*install, "--only-binary", ":all:", numpy, wheel], capture_output=True, text=True)
    if done.returncode and subprocess.run([*install, "--dry-run", "iniconfig"], capture_output=True).returncode:
        pytest.skip("no package can be installed here, so none of palpate's")
    assert done.returncode == 0, done.stderr
    found, _ = session(python, run, tmp_path, PYTHONPATH="")
    assert (found["numpy"] < "2") == (numpy == OLD)
    require_same(found["sums"], sums(run))
    require_outputs(tmp_path, run)
