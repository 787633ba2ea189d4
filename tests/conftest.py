from pathlib import Path

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


def pytest_collection_modifyitems(items):
    """The longest files first, those of the workflow: else one process would end with them alone."""
    items.sort(key=lambda item: "tests/workflow/" not in item.path.as_posix())
