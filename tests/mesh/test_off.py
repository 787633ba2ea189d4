"""OFF in the forms that Geomview documents and others write, against what the file was made of."""

import numpy as np
import pytest
from trimesh.visual.color import srgb_to_linear

from palpate.batch import UnusableObject
from palpate.mesh.load import load
from tests.mesh.reading import CASES, CORNERS, SIDES, measured, triangles

COLOURS = np.random.default_rng(0).integers(2, 255, (8, 3))
NORMALS = CORNERS - 0.5
UV = CORNERS[:, :2]


def write(path, keyword="OFF", columns=(), faces=SIDES, colours=None, head="{}\n8 6 12"):
    rows = np.column_stack([CORNERS, *columns]).tolist()
    lines = [head.format(keyword), *(" ".join(f"{number:g}" for number in row) for row in rows)]
    for number, face in enumerate(faces):
        lines.append(" ".join(map(str, (len(face), *face))) + (" " + colours[number] if colours else ""))
    path.write_text("\n".join(lines) + "\n")
    return load(path)[0].parts


def is_box(part):
    found = measured(part.triangles)
    return len(part.faces) == 12 and found["volume"] == pytest.approx(1) and found["area"] == pytest.approx(6)


def light(colours):
    return np.round(255 * srgb_to_linear(np.asarray(colours)[:, :3].astype(np.uint8)))


def test_polygons_of_the_cases():
    (part,) = load(CASES / "off-hexagon/hex.off")[0].parts
    assert len(part.faces) == 20 and part.is_watertight
    assert part.volume == pytest.approx(1.5 * np.sqrt(3), rel=1e-5)
    found = measured(triangles(load(CASES / "concave-polygon/u_profile.off")[0].parts))
    assert (found["area"], found["volume"]) == (pytest.approx(30), pytest.approx(7))


@pytest.mark.parametrize(
    "head", ["{}\n8 6 12", "{} 8 6 12", "{}8 6 0", "# a\n\n{} # b\n# c\n8 6 12 # d", "8 6 12", "\ufeff{}\r\n8 6 12\r"]
)
def test_heads(tmp_path, head):
    (part,) = write(tmp_path / "a.off", head=head)
    assert is_box(part) and "color" not in part.visual.vertex_attributes


def test_what_vertices_have(tmp_path):
    alpha = np.full(8, 255)
    forms = {
        "COFF": (COLOURS, alpha), "NOFF": (NORMALS,), "STOFF": (UV,), "CNOFF": (NORMALS, COLOURS, alpha),
        "STCNOFF": (NORMALS, COLOURS, UV),
    }  # fmt: skip
    for keyword, columns in forms.items():
        (part,) = write(tmp_path / "a.off", keyword, columns)
        assert is_box(part)
        assert ("color" in part.visual.vertex_attributes) == ("C" in keyword)
        if "C" in keyword:
            np.testing.assert_array_equal(part.visual.vertex_attributes["color"][:, :3], light(COLOURS))
        if "N" in keyword:
            np.testing.assert_allclose(part.metadata["vertex_normals"], NORMALS / np.sqrt(0.75))


@pytest.mark.parametrize("form", ["{} {} {}", "{} {} {} 255", "shares", "some"])
def test_colours_of_faces(tmp_path, form):
    texts = [form.format(*colour) for colour in COLOURS[:6]]
    if form == "shares":
        texts = [" ".join(f"{value / 255:.5f}" for value in colour) for colour in COLOURS[:6]]
    if form == "some":
        texts = ["{} {} {}".format(*colour) if number < 3 else "" for number, colour in enumerate(COLOURS[:6])]
    (part,) = write(tmp_path / "a.off", colours=texts)
    found = part.visual.vertex_attributes["color"][part.faces]
    expected = light(COLOURS[:6])
    expected[3:] = 204 if form == "some" else expected[3:]
    np.testing.assert_array_equal(found[:, :, :3], np.repeat(expected, 2, axis=0)[:, None].repeat(3, axis=1))
    assert is_box(part)


def test_an_entry_of_a_colour_table_does_not_count(tmp_path):
    (part,) = write(tmp_path / "a.off", colours=["1"] * 6)
    assert is_box(part) and "color" not in part.visual.vertex_attributes


@pytest.mark.parametrize("head", ["OFF BINARY\n8 6 12", "4OFF\n8 6 12", "nOFF\n4\n8 6 12"])
def test_binary_and_other_dimensions_are_said(tmp_path, head):
    with pytest.raises(UnusableObject, match="binary OFF, and OFF of other than three dimensions, are not read"):
        write(tmp_path / "a.off", head=head)


@pytest.mark.parametrize("index", [-1, 8])
def test_a_vertex_that_is_not_there_is_named(tmp_path, index):
    with pytest.raises(UnusableObject, match=f"a face refers to vertex {index} of 8"):
        write(tmp_path / "a.off", faces=[*SIDES[1:], (0, 1, index)])


@pytest.mark.parametrize("lines", [1, 5, 6, 8])
def test_one_that_is_cut_off(tmp_path, lines):
    write(tmp_path / "a.off")
    kept = (tmp_path / "a.off").read_text().splitlines()[:-lines]
    (tmp_path / "a.off").write_text("\n".join(kept))
    with pytest.raises(UnusableObject, match="cut off: it says"):
        load(tmp_path / "a.off")
