"""Files that hold less than they say, or say more than they can hold, are rejected with the reason."""

import json
import zipfile

import numpy as np
import PIL.Image
import pytest
import trimesh

from palpate import mesh
from palpate.batch import UnusableObject
from tests.mesh.written import BODY, RED, write

TRIANGLES = len(BODY.faces)


def cut(path, lines: int, characters: int = 0):
    """Take lines, and characters of the last one, from a file's end."""
    kept = path.read_text().splitlines()[:-lines] if lines else path.read_text().splitlines()
    text = "\n".join(kept)
    path.write_text(text[: len(text) - characters] + ("" if characters else "\n"))
    return path


@pytest.mark.parametrize("suffix", ["ply", "off"])
@pytest.mark.parametrize("by", ["vertex", "face"])
def test_fewer_faces_than_it_says(tmp_path, suffix, by):
    path = write(tmp_path / "in", suffix, RED, by=by)
    assert mesh.prepare(path, tmp_path / "whole")["visual.glb"]["faces"] == TRIANGLES
    for lines, left in ((202, TRIANGLES - 202), (TRIANGLES, 0)):
        with pytest.raises(UnusableObject, match=f"says {TRIANGLES:,} faces, and has {left:,}"):
            mesh.prepare(cut(write(tmp_path / "cut", suffix, RED, by=by), lines), tmp_path / "out")


@pytest.mark.parametrize("suffix", ["ply", "off"])
def test_a_file_that_ends_within_a_face(tmp_path, suffix):
    path = write(tmp_path, suffix)
    last = len(path.read_text().splitlines()[-1].split()[-1])
    with pytest.raises(UnusableObject, match=f"says {TRIANGLES:,} faces, and has {TRIANGLES - 1:,}"):
        mesh.prepare(cut(path, 0, last), tmp_path / "out")


def test_counts_in_the_first_line_and_comments_of_an_off(tmp_path):
    path = write(tmp_path, "off")
    head, counts, *rest = path.read_text().splitlines()
    path.write_text("\n".join([f"{head} {counts} # counts", "", "# corners", *rest]))
    assert mesh.prepare(path, tmp_path / "out")["visual.glb"]["faces"] == TRIANGLES


@pytest.mark.parametrize("face", ["f 0 1 2", "f 1 2 0", "f 1/1 0/2 2/3", "f 3//1 0//1 1//1", "f  2 1\t0 "])
def test_vertex_0_of_an_obj(tmp_path, face):
    lines = ["v 0 0 0", "v 1 0 0", "v 0 1 0", "v 0 0 1", "vt 0 0", "vt 1 0", "vt 0 1", "vn 0 0 1"]
    path = tmp_path / "a.obj"
    path.write_text("\n".join([*lines, "f 1 2 3", face, "f 1 3 4", ""]))
    with pytest.raises(UnusableObject, match="'.*0.*' names a vertex that is not there: they are 1 to 4"):
        mesh.prepare(path, tmp_path / "out")
    path.write_text("\n".join([*lines, "f 1 2 3", "f 1 3 4", "f 2 3 4", "# f 0 0 0", ""]))
    assert mesh.prepare(path, tmp_path / "out")["visual.glb"]["faces"] == 3


def test_an_accessor_of_a_million_million(tmp_path):
    path = write(tmp_path, "gltf")
    tree = json.loads(path.read_text())
    for change in ({"count": 10**12}, {"count": 10**12, "bufferView": None}, {"count": -1}):
        accessor = tree["accessors"][0] | change
        accessor = {key: value for key, value in accessor.items() if value is not None}
        path.write_text(json.dumps(tree | {"accessors": [accessor, *tree["accessors"][1:]]}))
        with pytest.raises(UnusableObject, match="accessor 0 says"):
            mesh.prepare(path, tmp_path / "out")


def test_json_that_is_nested_too_deep(tmp_path):
    path = tmp_path / "a.gltf"
    path.write_text('{"a":' + "[" * 200_000 + "]" * 200_000 + "}")
    with pytest.raises(UnusableObject, match="nested too deep"):
        mesh.prepare(path, tmp_path / "out")


def test_a_3mf_that_is_a_bomb(tmp_path):
    path = tmp_path / "a.3mf"
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("3D/3dmodel.model", "w") as file,
    ):
        for _ in range(600):
            file.write(b" " * 1_000_000)
    with pytest.raises(UnusableObject, match="600 MB unpacked"):
        mesh.prepare(path, tmp_path / "out")


def test_colours_of_an_off_in_shares_of_one_and_of_single_triangles(tmp_path):
    """Against what they were made of; numbers with a point are in 0..1, others in 0..255."""
    rows = ["COFF", "4 4 0", "0 0 0 1.0 0.0 0.0 1.0", "1 0 0 0.0 1.0 0.0 1.0", "0 1 0 0.0 0.0 1.0 1.0",
            "0 0 1 1.0 1.0 1.0 1.0", "3 0 2 1", "3 0 1 3", "3 0 3 2", "3 1 2 3"]  # fmt: skip
    (tmp_path / "a.off").write_text("\n".join(rows))
    mesh.prepare(tmp_path / "a.off", tmp_path / "out")
    (part,) = trimesh.load_scene(tmp_path / "out/visual.glb", process=False).geometry.values()
    colours = {tuple(row) for row in np.asarray(part.visual.vertex_attributes["color"])[:, :3].tolist()}
    assert colours == {(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 255)}


def test_colours_of_vertices_in_gltf_of_two_bytes(tmp_path):
    """As Blender writes them: with a material, and 16 bits a channel."""
    path = write(tmp_path, "gltf")
    tree = json.loads(path.read_text())
    colours = np.full((len(BODY.vertices), 4), 65535, dtype="<u2")
    colours[:, 1] = 32768
    (tmp_path / "colours.bin").write_bytes(colours.tobytes())
    tree["buffers"].append({"byteLength": colours.nbytes, "uri": "colours.bin"})
    tree["bufferViews"].append({"buffer": 1, "byteLength": colours.nbytes})
    accessor = {"bufferView": 3, "componentType": 5123, "normalized": True, "count": len(colours), "type": "VEC4"}
    tree["accessors"].append(accessor)
    tree["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = 3
    path.write_text(json.dumps(tree))
    mesh.prepare(path, tmp_path / "out")
    (part,) = trimesh.load_scene(tmp_path / "out/visual.glb", process=False).geometry.values()
    assert np.unique(part.visual.vertex_attributes["color"], axis=0).tolist() == [[255, 128, 255, 255]]


def test_a_picture_is_measured_by_its_head(tmp_path):
    """A file of a few bytes that says it has 60,000 pixels a side is not decoded."""
    path = write(tmp_path, "obj", texture=True)
    PIL.Image.new("1", (60_000, 1)).save(tmp_path / "picture.png")
    record = mesh.prepare(path, tmp_path / "out")
    assert "60000 x 1 pixels" in record["source"]["problems"]["picture.png"]
