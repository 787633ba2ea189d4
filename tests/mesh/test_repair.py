"""What repairing must not break: closed solids stay closed, and nothing that can be seen goes."""

from itertools import permutations

import numpy as np
import pytest
import trimesh

from palpate import mesh, shapes
from palpate.mesh import topology
from palpate.mesh.repair import TOLERANCE, repair
from tests.mesh.reading import CASES, CORNERS, SIDES

OBJECTS = [("bottle", 407), ("knife", 17), ("cellphone", 8), ("cellphone", 311), ("rifle", 4), ("rifle", 196)]


@pytest.mark.parametrize(("class_name", "index"), OBJECTS)
def test_closed_objects_stay_closed(class_name, index, tmp_path):
    repairs = stays_closed(shapes.write(class_name, index, tmp_path / "source"), tmp_path / "out")
    assert repairs["duplicate_faces_removed"] == 0


def test_an_object_in_which_welding_folds_a_sliver_flat_stays_closed(tmp_path):
    vertices, faces, _ = ball_with_flap(0.3 * TOLERANCE)
    trimesh.Trimesh(vertices, faces, process=False).export(tmp_path / "source.off", digits=12)
    assert stays_closed(tmp_path / "source.off", tmp_path / "out")["duplicate_faces_removed"] == 2


def stays_closed(source, out) -> dict:
    """Each part of the source is a closed solid, as trimesh sees it; so is what comes out, of the same
    volume. Returns the counts of repairs."""
    parts = trimesh.load_scene(source, process=False).dump()
    for part in parts:
        part.merge_vertices(merge_tex=True, merge_norm=True, digits_vertex=12)
    assert all(part.is_watertight for part in parts)
    record = mesh.prepare(source, out, collision_faces=10**6)
    facts = record["visual.glb"]
    assert facts["closed"]
    assert facts["volume"] / record["scale"] ** 3 == pytest.approx(sum(part.volume for part in parts), rel=1e-5)
    return record["repairs"]


def ball_with_flap(gap):
    """A ball with a flap of two faces on an edge ab: at a, its two sides are `gap` apart."""
    ball = trimesh.creation.icosphere(subdivisions=1)
    vertices, faces = ball.vertices, ball.faces.copy()
    a, b, _ = faces[0]
    across = next(face for face in faces if (b, a) in zip(face, np.roll(face, -1), strict=True))
    d = next(corner for corner in across if corner not in (a, b))
    across[across == a] = other = len(vertices)
    tip = other + 1
    flap = [(b, a, tip), (other, b, tip), (tip, a, other), (other, a, d)]
    new = [vertices[a] + gap * (vertices[d] - vertices[a]), 1.3 * (vertices[a] + vertices[b]) / 2]
    return np.r_[vertices, new], np.r_[faces, flap], len(faces)


def repaired(vertices, faces):
    return repair(vertices, faces, np.zeros(len(faces), dtype=int))


def test_a_flap_that_welding_flattens_goes_with_both_its_sides():
    vertices, faces, of_ball = ball_with_flap(0.3 * TOLERANCE)
    assert topology.is_closed(faces)
    found = repaired(vertices, faces)
    assert np.array_equal(found.keep, np.arange(len(faces)) < of_ball)
    assert topology.is_closed(found.faces[found.keep])


def test_a_thicker_flap_stays_whole():
    vertices, faces, _ = ball_with_flap(0.01)
    found = repaired(vertices, faces)
    assert found.keep.all()
    assert topology.is_closed(found.faces)


def test_a_fin_that_the_source_has_without_thickness_stays_as_one_face():
    """It can be seen, so it is no artefact of welding, though the ball alone would be closed."""
    vertices, faces, of_ball = ball_with_flap(0)
    found = repaired(vertices, faces)
    assert found.keep.sum() == of_ball + 1
    assert found.keep[of_ball]


def test_a_plate_thinner_than_the_tolerance_stays_as_a_sheet():
    low = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
    sides = [(0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
    quads = np.array([(3, 2, 1, 0), (5, 6, 7, 4), *sides])
    faces = np.r_[quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]
    found = repaired(np.r_[low, low + (0, 0, 0.1 * TOLERANCE)], faces)
    sheet = trimesh.Trimesh(found.vertices, found.faces[found.keep], process=False)
    assert sheet.area == pytest.approx(1)


SIDE = np.array(SIDES)
BOX, OTHER = (np.r_[sides[:, [0, 1, 2]], sides[:, [0, 2, 3]]] for sides in (SIDE, np.roll(SIDE, 1, axis=1)))
OPEN = BOX[np.r_[1:6, 7:12]]  # without one side


def kept(*parts):
    """How many faces of each part stay, and the surface; a part: its faces of the box, or (faces, shift)."""
    parts = [each if isinstance(each, tuple) else (each, 0) for each in parts]
    vertices = np.concatenate([CORNERS + (shift, 0, 0) for _, shift in parts])
    faces = np.concatenate([faces + 8 * number for number, (faces, _) in enumerate(parts)])
    part = np.repeat(np.arange(len(parts)), [len(faces) for faces, _ in parts])
    found = repair(vertices, faces, part)
    surface = trimesh.Trimesh(found.vertices, found.faces[found.keep], process=False)
    return np.bincount(part[found.keep], minlength=len(parts)).tolist(), surface, found.flip


@pytest.mark.parametrize("outside", [BOX, OTHER])
def test_of_a_shell_and_its_back_the_one_that_faces_out_stays(outside):
    """In whatever order, and however their sides are cut in two: the back has the other material."""
    back = BOX[:, ::-1]
    for parts, expected in (((back, outside), [0, 12]), ((outside, back), [12, 0]), ((BOX, outside), [12, 0])):
        counts, surface, flip = kept(*parts)
        assert counts == expected and surface.is_watertight and surface.volume == pytest.approx(1) and not flip.any()


def test_of_two_shells_that_face_in_the_first_is_turned():
    counts, surface, flip = kept(BOX[:, ::-1], BOX[:, ::-1])
    assert counts == [12, 0] and surface.volume == pytest.approx(1) and flip[:12].all()


@pytest.mark.parametrize(
    ("parts", "expected"),
    [
        ((BOX[:, ::-1], BOX[:6], BOX[6:]), [0, 6, 6]),  # two materials outside, neither closed
        ((BOX[:6], BOX[6:], BOX[:, ::-1]), [6, 6, 0]),
        ((BOX[:6, ::-1], BOX[:6], BOX[6:], BOX[6:, ::-1]), [0, 6, 6, 0]),
        ((OPEN[:, ::-1], OPEN), [0, 10]),  # without a lid
        ((OPEN, OPEN[:, ::-1]), [10, 0]),
        ((OPEN[:, ::-1], BOX), [0, 12]),
        ((BOX, OPEN[:, ::-1]), [12, 0]),
        ((BOX[:, ::-1], OPEN), [2, 10]),  # one side has its back alone
        ((BOX[[0, 6]][:, ::-1], BOX[[0, 6]]), [2, 0]),  # sheets that are seen from both sides: the first
    ],
)
def test_of_faces_that_coincide_the_one_that_faces_out_stays(parts, expected):
    counts, surface, _ = kept(*parts)
    assert counts == expected
    if sum(expected) == 12:
        assert surface.is_watertight and surface.volume == pytest.approx(1)


def test_solids_that_share_a_wall_keep_it_and_a_back_of_one_goes():
    counts, surface, _ = kept(BOX, (BOX, 1))
    assert counts == [12, 12] and surface.is_watertight and surface.volume == pytest.approx(2)
    counts, surface, _ = kept(BOX[:, ::-1], (BOX, 1), BOX)
    assert counts == [0, 12, 12] and surface.is_watertight and surface.volume == pytest.approx(2)


@pytest.mark.parametrize("parts", [*permutations([BOX, (BOX, 1), BOX[[1, 7]]])])
def test_two_solids_and_a_sheet_in_the_wall_between_keep_it_once(parts):
    """In whatever order: each is merged with the others."""
    counts, surface, _ = kept(*parts)
    assert sum(counts) == 22 and len(surface.vertices) == 12


def test_the_case_of_two_materials_is_red(tmp_path):
    record = mesh.prepare(CASES / "coincident-two-materials/box.obj", tmp_path)
    assert record["visual.glb"]["faces"] == 12 and record["repairs"]["duplicate_faces_removed"] == 12
    (part,) = trimesh.load_scene(tmp_path / "visual.glb", process=False).geometry.values()
    np.testing.assert_array_equal(part.visual.material.baseColorFactor[:3], [204, 0, 0])
