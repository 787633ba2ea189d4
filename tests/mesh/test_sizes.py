"""Objects that keep their size: metres as the file has them, in whatever unit, within what a hand can hold."""

import json

import numpy as np
import pytest
import trimesh

from palpate import mesh
from palpate.batch import UnusableObject
from tests.mesh.reading import CASES

MUG = np.array([0.08, 0.12, 0.095])  # m


def written(path, extents, **options):
    trimesh.creation.box(extents).apply_translation((3, -2, 1)).export(path / "box.stl")
    return mesh.prepare(path / "box.stl", path / "out", collision_faces=100, **options)


@pytest.mark.parametrize(
    ("unit", "scale", "factor"), [(1, "keep", 1), (1000, 0.001, 0.001), (39.37, 0.0254, 0.0254), (1, 2, 2)]
)
def test_a_mug_is_as_large_as_a_mug(tmp_path, unit, scale, factor):
    record = written(tmp_path, unit * MUG, scale=scale)
    for file in ("visual.glb", "collision.ply"):
        made = trimesh.load_mesh(tmp_path / "out" / file)
        np.testing.assert_allclose(made.extents, unit * factor * MUG, rtol=1e-6)
        np.testing.assert_allclose(made.bounds.mean(axis=0), 0, atol=1e-7)
    assert record["scale"] == factor and record["source"]["scale"] == scale
    size = unit * factor * np.linalg.norm(MUG)
    assert record["diagonal"] == pytest.approx(size, rel=1e-6)
    assert record == json.loads((tmp_path / "out/mesh.json").read_text()) == mesh.read_record(tmp_path / "out")


@pytest.mark.parametrize(
    ("case", "sides", "scale"),
    [
        ("dae-unit-inch/block.dae", (4 * 0.0254, 3 * 0.0254, 2 * 0.0254), 0.0254),
        ("dae-unit-comma/block.dae", (0.04, 0.03, 0.02), 0.01),
        ("3mf-millimetre/block.3mf", (0.04, 0.03, 0.02), 0.001),
    ],
)
def test_keep_takes_the_unit_that_a_file_states_and_a_number_does_not(tmp_path, case, sides, scale):
    record = mesh.prepare(CASES / case, tmp_path / "out", scale="keep")
    np.testing.assert_allclose(mesh.load_visual(tmp_path / "out").extents, sides, rtol=1e-5)
    assert record["scale"] == scale and record["diagonal"] == pytest.approx(np.linalg.norm(sides), rel=1e-5)
    given = mesh.prepare(CASES / case, tmp_path / "given", scale=0.02)
    np.testing.assert_allclose(given["diagonal"], np.linalg.norm(sides) / scale * 0.02, rtol=1e-5)


def test_one_size_is_the_default(tmp_path):
    record = written(tmp_path, 7 * MUG)
    assert record["diagonal"] == mesh.DIAGONAL
    assert record["scale"] == pytest.approx(mesh.DIAGONAL / np.linalg.norm(7 * MUG), rel=1e-6)
    assert mesh.read_record(tmp_path) == {}  # a folder without a record


@pytest.mark.parametrize(
    ("extents", "scale", "says"),
    [
        (
            1000 * MUG,
            "keep",
            r"at scale keep it is 173 m across.* 0.005 to 2 m.*`scale` \(0.001 for millimetres; here ",
        ),
        (1000 * MUG, "keep", r"here 0.001 or 0.01 would fit"),
        (0.01 * MUG, "keep", r"at scale keep it is 0.00173 m across"),
        (MUG, 0.001, r"at scale 0.001 it is 0.000173 m across.*here 1 would fit"),
        (1e9 * MUG, "keep", r"millimetres\), in the config's source or for this object in the file of source.objects"),
    ],
)
def test_a_size_that_cannot_be_right_is_rejected_with_the_remedy(tmp_path, extents, scale, says):
    with pytest.raises(UnusableObject, match=says) as error:
        written(tmp_path, extents, scale=scale)
    assert "box.stl" in str(error.value) and "\n" not in str(error.value)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("edge", "usable"), [(0.0028, False), (0.003, True), (1.15, True), (1.16, False)])
def test_bounds_are_of_the_diagonal(tmp_path, edge, usable):
    try:
        written(tmp_path, (edge,) * 3, scale="keep")
    except UnusableObject:
        assert not usable
    else:
        assert usable
