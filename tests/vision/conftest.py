import pytest
import trimesh

from palpate.hand import allegro


@pytest.fixture(scope="session")
def hand():
    return allegro()


@pytest.fixture
def write_glb(tmp_path):
    """Writes meshes of one scene as `<name>/visual.glb`; returns the path."""

    def write(name, *meshes):
        path = tmp_path / name / "visual.glb"
        path.parent.mkdir()
        path.write_bytes(trimesh.Scene(meshes).export(file_type="glb"))
        return path

    return write
