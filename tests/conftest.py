import gc
import os
import subprocess
from pathlib import Path

import pytest

gc.disable()  # until all is imported: what modules hold would be searched for garbage again and again

TESTS = Path(__file__).parent
WORKFLOW = TESTS / "workflow"
WITHOUT_BLENDER = ("catalogue", "charts", "grasp", "hand", "models", "shapes", "store", "surface", "touch")


def pytest_configure(config):
    """Import Blender, which takes seconds, unless only folders are asked for that don't need it.

    bpy must come before anything that loads embree (trimesh does): the other way round fails with an undefined symbol.
    """
    if config.getoption("numprocesses", None):  # the main process of pytest-xdist runs no test
        return
    places = [Path(str(argument).split("::")[0]).resolve() for argument in config.args]
    folders = [TESTS / name for name in WITHOUT_BLENDER]
    if not all(any(place.is_relative_to(folder) for folder in folders) for place in places):
        import bpy  # noqa: F401


@pytest.hookimpl(tryfirst=True)  # pytest-xdist reads the groups after this
def pytest_collection_modifyitems(items):
    """The longest tests first, those of the workflow: else one process would end with them alone.

    A group of pytest-xdist runs in one process: the tests of a file, for its fixtures; of the workflow, those that
    share the finished run, which is made once, or a run of their file. Its other tests are in no group.
    """
    items.sort(key=lambda item: WORKFLOW not in item.path.parents)
    for item in items:
        if "finished" in item.fixturenames:
            item.add_marker(pytest.mark.xdist_group("finished"))
        elif WORKFLOW not in item.path.parents or {"run", "workflow", "smoke"} & {*item.fixturenames}:
            item.add_marker(pytest.mark.xdist_group(str(item.path.relative_to(TESTS))))


def pytest_collection_finish():
    gc.freeze()
    gc.enable()


def pytest_unconfigure():
    """Blender ends itself when its module is freed: else the process waits for a thread of it at its end, forever."""
    gc.unfreeze()


@pytest.fixture
def small_disk(request, tmp_path):
    """A folder that is a file system of its own, with the options of tmpfs that the test is given indirectly."""
    folder = tmp_path / "small"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", request.param, "tmpfs", str(folder)]
    if os.geteuid() != 0 or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("only root may mount a file system")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)
