"""The study of touch: its reference against closed forms and longer arithmetic; its errors on a small run."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from palpate import mesh, store
from palpate.sensor import DIGIT
from palpate.touch import PIXEL_CENTRES, SENSOR_RANGE, RayCaster, SphereTracer
from studies.error_vs_runtime import touch
from studies.subjects import Subject

Y, Z = np.meshgrid(PIXEL_CENTRES, PIXEL_CENTRES)
SETTINGS = {"touch": {"method": "embree"}, "mesh": {"levels": [320]}}


def lumpy(subdivisions=3) -> trimesh.Trimesh:
    """A bumpy closed surface about 0.1 m wide: 1280 faces, or 320 that have some of its vertices."""
    made = trimesh.creation.icosphere(subdivisions=subdivisions, radius=0.05)
    x, y, z = 100 * made.vertices.T
    made.vertices *= 1 + 0.1 * (np.sin(3 * x) * np.sin(4 * y + 1) * np.cos(3 * z))[:, None]
    return made


def poses(made: trimesh.Trimesh, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Sensors whose planes are 15 mm in front of random spots, tilted at random."""
    points, face = trimesh.sample.sample_surface(made, count, seed=1)
    tilt = Rotation.from_rotvec(0.3 * np.random.default_rng(1).standard_normal((count, 3)))
    x = tilt.apply(-made.face_normals[face])
    z = np.cross(x, [0.3, 0.5, 0.8])
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    return points - 0.015 * x, np.stack([x, np.cross(z, x), z], axis=2)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run with two objects, and two grasps of the second, of which six sensors touch."""
    folder = tmp_path_factory.mktemp("run")
    subject = Subject("lump-0000", "lump", "batch-0000", folder / "meshes/batch-0000/lump-0000")
    subject.folder.mkdir(parents=True)
    made = lumpy()
    made.export(subject.folder / "visual.glb")
    made.export(subject.folder / "collision.ply")
    lumpy(subdivisions=2).export(subject.folder / "level-320.ply")
    position, rotation = poses(made, 8)
    position[[1, 6]] += 0.2

    def of_second(values):
        return np.stack([np.zeros_like(values), values])

    arrays = {
        "object": np.array(["another", subject.name]),
        "joint_positions": np.zeros((2, 2, 16)),
        "palm_pose": np.zeros((2, 2, 4, 4)),
        "link_pose": np.zeros((2, 2, 17, 4, 4)),
        "sensor_position": of_second((position + mesh.OBJECT_POSITION).reshape(2, 4, 3)),
        "sensor_rotation": of_second(rotation.reshape(2, 4, 3, 3)),
        "touches": of_second(np.array([[True, False, True, True], [True, True, False, True]])),
        "penetration": np.zeros((2, 2), dtype=np.float32),
        "attempts": np.ones(2, dtype=np.int32),
    }
    (folder / "grasps").mkdir()
    attributes = {"made_from": {}, "seed": 0, "sensor": DIGIT.description()}
    store.write(folder / "grasps/batch-0000.h5", "grasps", arrays, attributes)
    return folder, subject


@pytest.fixture(scope="module")
def case(run):
    folder, subject = run
    ((name, found),) = touch.study(folder, [subject], SETTINGS).cases()
    assert name == subject.name
    return found


@pytest.fixture(scope="module")
def rows(run, case):
    """Errors by method, knob and value."""
    found = touch.study(*[run[0], [run[1]]], SETTINGS)
    return {(m.name, m.knob, m.value): found.errors(case, m.run(case)) for m in found.methods()}


def test_reference_of_a_slanted_plane():
    y, z = np.array([-1, 1, 1, -1]) * 0.02, np.array([-1, -1, 1, 1]) * 0.02
    corners = np.column_stack([0.024 + 0.2 * y - 0.1 * z, y, z])
    expected = 0.024 + 0.2 * Y - 0.1 * Z
    expected[expected > SENSOR_RANGE] = np.inf
    assert 0.1 < np.isinf(expected).mean() < 0.9
    turn, place = Rotation.from_rotvec([0.4, -1.0, 2.0]).as_matrix(), np.array([0.1, -0.2, 0.3])
    triangles = corners[[[0, 1, 2], [0, 2, 3]]] @ turn.T + place
    np.testing.assert_allclose(touch.exact_depth(triangles, place, turn), expected, atol=1e-15)


def test_reference_is_as_good_as_exact():
    """Longer arithmetic (64 bits of mantissa) changes no depth by 1e-12 m, and no pixel."""
    assert np.finfo(np.longdouble).eps < np.finfo(float).eps, "no longer arithmetic on this machine"
    made = lumpy()
    for position, rotation in zip(*poses(made, 4), strict=True):
        depth = touch.exact_depth(np.asarray(made.triangles), position, rotation)
        longer = (part.astype(np.longdouble) for part in (made.triangles, position, rotation))
        exact = touch.exact_depth(*longer)
        assert exact.dtype == np.longdouble and np.isfinite(depth).any()
        np.testing.assert_array_equal(np.isfinite(depth), np.isfinite(exact))
        touched = np.isfinite(depth)
        assert np.abs(depth[touched] - exact[touched]).max() < 1e-12


def test_reference_leaves_out_no_face():
    """As solving start + t x = a + u (b - a) + v (c - a) for every face, in the mesh's frame."""
    made = lumpy()
    position, rotation = (part[0] for part in poses(made, 1))
    rows, columns = np.random.default_rng(0).integers(100, size=(2, 200))
    depth = touch.exact_depth(np.asarray(made.triangles), position, rotation)[rows, columns]
    a, b, c = np.asarray(made.triangles).swapaxes(0, 1)
    system = np.stack([b - a, c - a, np.broadcast_to(-rotation[:, 0], a.shape)], axis=2)
    for found, y, z in zip(depth, PIXEL_CENTRES[columns], PIXEL_CENTRES[rows], strict=True):
        start = position + rotation @ [0, y, z]
        u, v, t = np.linalg.solve(system, (start - a)[..., None])[..., 0].T
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t >= 0) & (t <= SENSOR_RANGE)
        assert found == pytest.approx(t[hit].min(initial=np.inf), abs=1e-12)


def test_the_cases_are_the_first_touches(case, run):
    position, rotation = poses(lumpy(), 8)
    np.testing.assert_allclose(case.position, position[[0, 2, 3, 4]], atol=1e-12)
    np.testing.assert_allclose(case.rotation, rotation[[0, 2, 3, 4]])
    assert np.isfinite(case.depth).any(axis=(1, 2)).all()
    assert list(case.decimated) == ["collision.ply", "level-320.ply"]
    assert len(case.decimated["level-320.ply"].faces) == 320 < len(case.visual.faces)


def test_the_reference_has_no_error(case, run):
    errors = touch.study(run[0], [run[1]], SETTINGS).errors(case, case.depth)
    assert errors == dict.fromkeys(errors, 0.0)


def test_errors_are_what_they_are_called(case, run):
    """A millimetre added to all, and one pixel of each sensor lost."""
    found, depth = touch.study(run[0], [run[1]], SETTINGS), case.depth + 1e-3
    for each in depth:
        each[tuple(np.argwhere(np.isfinite(each))[0])] = np.inf
    errors = found.errors(case, depth)
    assert errors["depth"] == pytest.approx(1) and errors["worst depth"] == pytest.approx(1)
    assert errors["flipped"] == pytest.approx(0.01) and 0 < errors["reading"] < 255
    nothing = found.errors(case, np.full_like(case.depth, np.inf))
    assert np.isnan(nothing["depth"])
    assert nothing["flipped"] == pytest.approx(100 * np.isfinite(case.depth).mean())


def test_double_precision_is_exact(rows):
    for name in ("embree", "trimesh's wrapper"):
        errors = rows[name, "precision", "double"]
        assert errors["worst depth"] < 1e-5 and errors["flipped"] == 0 == errors["reading"]
    assert 1e-7 < rows["embree alone", "precision", "single"]["depth"] < 1e-3


def test_a_knob_that_tightens_errs_less(rows):
    by_tolerance = [rows["sphere tracing", "tolerance, m", value] for value in touch.TOLERANCES]
    for measure in ("depth", "worst depth", "flipped", "reading"):
        errors = [each[measure] for each in by_tolerance]
        assert errors == sorted(errors, reverse=True) and errors[-1] < errors[0] / 2, measure
    # A ray that is given up is a miss; what has arrived stays.
    flipped = [rows["sphere tracing", "steps", value]["flipped"] for value in touch.STEPS]
    assert flipped == sorted(flipped, reverse=True) and flipped[0] > flipped[-1]
    cells = [rows["sphere tracing on a grid", "cells a side", value]["depth"] for value in touch.CELLS]
    assert cells == sorted(cells, reverse=True)


def test_fewer_faces_err_more(rows):
    errors = [rows["embree, fewer faces", "mesh", file] for file in ("collision.ply", "level-320.ply")]
    assert errors[0]["depth"] < 1e-5 < 1e-2 < errors[1]["depth"]


def test_the_grid_is_exact_where_distance_is_linear():
    """In front of a large flat face every step lands; from inside the object the way out is met."""
    box = trimesh.creation.box((0.2, 0.3, 0.3))
    outside, inside = np.array([-0.11, 0, 0]), np.array([-0.09, 0, 0])
    depth = touch.traced_on_grid(box, np.stack([outside, inside]), np.stack([np.eye(3), np.diag([-1.0, -1, 1])]), 4)
    np.testing.assert_allclose(depth, 0.01, atol=2e-5)


@pytest.mark.parametrize("method, tracer", [("embree", RayCaster), ("sphere_tracing", SphereTracer)])
def test_chosen_is_what_the_config_says(run, case, method, tracer):
    found = touch.study(run[0], [run[1]], {**SETTINGS, "touch": {"method": method}})
    (chosen,) = [each for each in found.methods() if each.chosen]
    expected = tracer(case.visual).trace(case.position, case.rotation)
    np.testing.assert_array_equal(chosen.run(case), expected)
