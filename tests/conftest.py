from pathlib import Path

import pytest

TESTS = Path(__file__).parent
WITHOUT_BLENDER = ("catalogue", "charts", "grasp", "hand", "models", "shapes", "store", "surface", "touch")


def pytest_configure(config):
    """Import Blender, which takes seconds, unless only folders are asked for that don't need it.

    bpy must come before anything that loads embree (trimesh does): the other way round fails with an undefined symbol.
    """
    places = [Path(str(argument).split("::")[0]).resolve() for argument in config.args]
    folders = [TESTS / name for name in WITHOUT_BLENDER]
    if not all(any(place.is_relative_to(folder) for folder in folders) for place in places):
        import bpy  # noqa: F401


@pytest.hookimpl(tryfirst=True)  # pytest-xdist reads the groups after this
def pytest_collection_modifyitems(items):
    """The longest tests first, those of the workflow: else one process would end with them alone.

    Groups of pytest-xdist run in one process. Tests of a file do, for its fixtures. Of the workflow, those that share
    the finished run do, so that it is made once; others of its files are free, as far as they share no run.
    """
    items.sort(key=lambda item: "tests/workflow/" not in item.path.as_posix())
    for item in items:
        free = "tests/workflow/" in item.path.as_posix() and not {"run", "workflow", "smoke"} & {*item.fixturenames}
        group = "finished" if "finished" in item.fixturenames else item.nodeid if free else str(item.path)
        item.add_marker(pytest.mark.xdist_group(group))
