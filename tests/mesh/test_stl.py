"""STL as others write it: names, several solids, bytes after the triangles, files that are cut off."""

import numpy as np
import pytest
import trimesh

from palpate.batch import UnusableObject
from palpate.mesh.load import load
from tests.mesh.reading import CASES, assert_same, by_blender, measured, triangles

BOX = trimesh.creation.box((1, 2, 3))
BALL = trimesh.creation.icosphere(subdivisions=1).apply_translation((5, 0, 0))


def text(mesh, name="", number="{:.9g}", end="\n") -> str:
    lines = [f"solid {name}"]
    for corners in mesh.triangles:
        lines += ["  facet normal 0 0 0", "    outer loop"]
        lines += ["      vertex " + " ".join(number.format(value) for value in corner) for corner in corners]
        lines += ["    endloop", "  endfacet"]
    return end.join([*lines, f"endsolid {name}", ""])


def read(path, content):
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return load(path)[0].parts


def test_the_word_vertex_in_a_name_is_no_vertex():
    (part,) = load(CASES / "stl-name/vertex_name.stl")[0].parts
    assert len(part.faces) == 12
    assert measured(triangles([part]))["volume"] == pytest.approx(1)


@pytest.mark.parametrize(
    "name", ["", "vertex 1 2 3", "facet normal 0 0 1", "my solid", "endsolid", "größe", "loop endfacet"]
)
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_names_and_ends_of_lines(tmp_path, name, end):
    (part,) = read(tmp_path / "a.stl", text(BOX, name, end=end))
    np.testing.assert_allclose(part.triangles, BOX.triangles)


@pytest.mark.parametrize("number", ["{:e}", "{:.3E}", "{:+f}", "{:.17g}"])
def test_forms_of_numbers(tmp_path, number):
    (part,) = read(tmp_path / "a.stl", text(BOX, "a", number).upper())
    np.testing.assert_allclose(part.triangles, BOX.triangles, rtol=1e-3)


def test_each_solid_is_a_part_and_blender_reads_as_much(tmp_path):
    parts = read(tmp_path / "a.stl", text(BOX, "box") + "\n" + text(BALL, "ball"))
    assert [len(part.faces) for part in parts] == [12, 80]
    (tmp_path / "b.stl").write_bytes(BALL.export(file_type="stl"))
    expected = by_blender(tmp_path / "a.stl", tmp_path / "b.stl")
    assert_same(measured(triangles(parts)), expected[0])
    assert_same(measured(triangles(load(tmp_path / "b.stl")[0].parts)), expected[1])


@pytest.mark.parametrize("start", [b"", b"solid ", b"solid facet", b"COLOR=\xff\x00\x00\xff"])
@pytest.mark.parametrize("rest", [b"", b"\0", b"made by something\n", bytes(50), bytes(1000)])
def test_a_binary_one_with_bytes_after_it_and_any_header(tmp_path, start, rest):
    data = BALL.export(file_type="stl")
    (part,) = read(tmp_path / "a.stl", start + data[len(start) :] + rest)
    np.testing.assert_allclose(part.triangles, BALL.triangles, atol=1e-6)


@pytest.mark.parametrize("keep", [30, 83, 84, 134, 84 + 79 * 50, 84 + 80 * 50 - 1])
@pytest.mark.parametrize("start", [b"", b"solid "])
def test_a_binary_one_that_is_cut_off(tmp_path, keep, start):
    data = BALL.export(file_type="stl")
    with pytest.raises(UnusableObject, match="cut off: it says|nothing but zeros"):
        read(tmp_path / "a.stl", (start + data[len(start) :])[:keep])


@pytest.mark.parametrize("lines", [1, 2, 3, 5, 8, 40])
def test_a_text_that_is_cut_off(tmp_path, lines):
    with pytest.raises(UnusableObject, match="cut off"):
        read(tmp_path / "a.stl", "\n".join(text(BOX, "a").splitlines()[:-lines]))


def test_a_facet_without_three_vertices(tmp_path):
    lines = text(BOX, "a").splitlines()
    with pytest.raises(UnusableObject, match="not three vertices"):
        read(tmp_path / "a.stl", "\n".join(lines[:3] + lines[4:]))


def test_without_triangles(tmp_path):
    for content in ("solid a\nendsolid a\n", bytes(84)):
        with pytest.raises(UnusableObject, match="no triangles|nothing but zeros"):
            read(tmp_path / "a.stl", content)
