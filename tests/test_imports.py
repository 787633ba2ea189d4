"""Imports go one way: each package imports only those before it in `ORDER`, and engines where they belong."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import palpate

ROOT = Path(palpate.__file__).parent
# From what everything else stands on to what stands on everything else; docs/design.md has the same order.
ORDER = (
    *("lazy", "stages", "rebuild_command", "seal", "atomic", "text_files", "batch"),
    *("configuration", "strategies", "experiments", "architectures"),
    *("camera", "sensor", "named_files"),
    *("mesh", "surface", "hand", "scene", "touch", "grasp", "vision", "shapes", "store", "released", "catalogue"),
    *("dataset", "protocol", "charts", "models", "learning", "results"),
    *("viewer", "interchange", "check", "command"),
)
# Packages that may import an engine: by the name that is imported.
ENGINES = {
    "mujoco": {"hand", "grasp"},
    "bpy": {"vision"},
    "mathutils": {"vision"},
    "torch": {"charts", "models", "learning", "results"},
    "lightning_fabric": {"learning"},
    "snakemake": set(),
    "studies": set(),
}


def imports() -> Iterator[tuple[str, str, str]]:
    """Package, imported module, and place, of every import in the library, also of those within functions."""
    for file in sorted(ROOT.rglob("*.py")):
        package = file.relative_to(ROOT).parts[0].removesuffix(".py")
        if package == "__init__":
            continue
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and not node.level:
                whole = node.module == "palpate"
                names = [f"palpate.{alias.name}" for alias in node.names] if whole else [node.module]
            else:
                continue
            for name in names:
                yield package, name, f"{file.relative_to(ROOT)}:{node.lineno}"


def test_every_package_has_its_place():
    found = {path.stem for path in ROOT.iterdir() if path.suffix == ".py" or (path / "__init__.py").exists()}
    assert found - {"__init__"} == set(ORDER)


def test_packages_import_only_those_before_them():
    wrong = []
    for package, name, place in imports():
        parts = name.split(".")
        within = parts[0] == "palpate" and len(parts) > 1 and parts[1] in ORDER
        if within and ORDER.index(parts[1]) > ORDER.index(package):
            wrong.append(f"{place}: {package} imports {name}")
    assert not wrong


@pytest.mark.parametrize("engine", ENGINES)
def test_engines_are_imported_where_they_belong(engine):
    found = {package: place for package, name, place in imports() if name.split(".")[0] == engine}
    assert set(found) <= ENGINES[engine], found


def test_tables_of_models_wait_for_no_engine():
    code = (
        "import sys; from palpate.results import claims, model_figures, model_tables;"
        "sys.exit(any(name in sys.modules for name in ('torch', 'mujoco', 'bpy')))"
    )
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0
