# bpy must be imported before anything that loads embree (trimesh does): the other way round fails with an
# undefined symbol.
import bpy  # noqa: F401


def pytest_collection_modifyitems(items):
    """The longest files first, those of the workflow: else one process would end with them alone."""
    items.sort(key=lambda item: "tests/workflow/" not in item.path.as_posix())
