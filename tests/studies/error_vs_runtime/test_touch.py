"""The study of touch: its reference against closed forms and longer arithmetic; its errors on a small run."""

import numpy as np
import pytest

from palpate import mesh, store
from palpate.sensor import DIGIT
from palpate.touch import RayCaster
from studies.error_vs_runtime import touch
from studies.subjects import Subject
from tests.studies.lumps import lumpy, poses

SETTINGS: dict = {}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run with two objects, and two grasps of the second, of which six sensors touch."""
    folder = tmp_path_factory.mktemp("run")
    subject = Subject("lump-0000", "lump", "batch-0000", folder / "meshes/batch-0000/lump-0000")
    subject.folder.mkdir(parents=True)
    made = lumpy()
    made.export(subject.folder / "visual.glb")
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


def test_the_cases_are_the_first_touches(case, run):
    position, rotation = poses(lumpy(), 8)
    np.testing.assert_allclose(case.position, position[[0, 2, 3, 4]], atol=1e-12)
    np.testing.assert_allclose(case.rotation, rotation[[0, 2, 3, 4]])
    assert np.isfinite(case.depth).any(axis=(1, 2)).all()


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
    errors = rows["embree", "precision", "double"]
    assert errors["worst depth"] < 1e-5 and errors["flipped"] == 0 == errors["reading"]


def test_a_knob_that_tightens_errs_less(rows):
    by_tolerance = [rows["sphere tracing", "tolerance, m", value] for value in touch.TOLERANCES]
    for measure in ("depth", "worst depth", "flipped", "reading"):
        errors = [each[measure] for each in by_tolerance]
        assert errors == sorted(errors, reverse=True) and errors[-1] < errors[0] / 2, measure


def test_chosen_is_the_library_s_ray_caster(run, case):
    (chosen,) = [each for each in touch.study(run[0], [run[1]], SETTINGS).methods() if each.chosen]
    expected = RayCaster(case.visual).trace(case.position, case.rotation)
    np.testing.assert_array_equal(chosen.run(case), expected)
