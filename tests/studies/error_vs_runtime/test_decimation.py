"""The study of decimation: what it measures against closed forms, and that it decimates as a run does."""

import numpy as np
import pytest
import trimesh

from palpate import mesh, shapes
from palpate.mesh.decimate import decimate
from palpate.mesh.distance import Surface
from studies.error_vs_runtime.decimation import Source, load_source, study
from studies.subjects import Subject
from studies.surface_distance import distances, sample

FACES = 1500
SETTINGS = {"mesh": {"collision_faces": FACES}}


@pytest.fixture(scope="module")
def subject(tmp_path_factory):
    """A bottle of several parts, prepared as in a run."""
    folder = tmp_path_factory.mktemp("bottle")
    shapes.make("bottle", 1).export(folder / "source.glb")
    mesh.prepare(folder / "source.glb", folder / "mesh", collision_faces=FACES)
    return Subject("bottle-0001", "bottle", "batch-0000", folder / "mesh")


@pytest.fixture(scope="module")
def source(subject):
    return load_source(subject.folder)


def case_of(geometry):
    vertices, faces = np.array(geometry.vertices, dtype=float), np.array(geometry.faces, dtype=np.int64)
    return Source(vertices, faces, Surface(vertices, faces))


def by_name(part, knob="faces"):
    return [m for m in study(None, [], SETTINGS).methods() if part in m.name and m.knob == knob]


def test_what_is_chosen_is_the_collision_mesh_of_the_run(subject):
    made = study(None, [subject], SETTINGS)
    ((name, case),) = made.cases()
    chosen = [method for method in made.methods() if method.chosen]
    assert name == subject.name and [(m.knob, m.value) for m in chosen] == [("faces", FACES)]
    expected = mesh.load_collision(subject.folder)
    for method in chosen:
        vertices, faces = method.run(case)
        np.testing.assert_array_equal(faces, expected.faces)
        np.testing.assert_array_equal(vertices, expected.vertices)


def test_every_method_makes_a_closed_mesh_smaller_and_has_an_error(source):
    made = study(None, [], SETTINGS)
    for method in made.methods():
        if method.knob == "faces" and method.value != FACES:
            continue
        errors = made.errors(source, method.run(source))
        assert 0 < errors["mean distance"] < errors["distance"] < 100, method
        assert 0 < errors["faces"] < len(source.faces), method


@pytest.mark.parametrize("library", ["pymeshlab", "libigl"])
def test_more_faces_are_nearer(source, library):
    made = study(None, [], SETTINGS)
    methods = [m for m in by_name(f"quadric collapse ({library})") if m.value <= FACES]
    means = [made.errors(source, method.run(source))["mean distance"] for method in methods]
    assert len(means) > 3 and (np.diff(means) < 0).all()


def test_distances_of_a_larger_box():
    """1 mm outside all around: at the corners sqrt(3) mm, on average a little more than 1."""
    inner = trimesh.creation.box((0.2,) * 3)
    for _ in range(3):
        inner = inner.subdivide()
    outer = trimesh.creation.box((0.202,) * 3)
    errors = study(None, [], SETTINGS).errors(case_of(inner), (np.array(outer.vertices), np.array(outer.faces)))
    assert errors["distance"] == pytest.approx(np.sqrt(3))
    assert errors["mean distance"] == pytest.approx(1.0, abs=0.01)
    assert errors["faces"] == 12


def test_what_is_refused_has_nan_and_what_is_small_already_stays_as_it_is():
    sheet = trimesh.creation.box((0.2,) * 3).subdivide().subdivide().subdivide()
    case = case_of(trimesh.Trimesh(sheet.vertices, sheet.faces[20:], process=False))
    made = study(None, [], SETTINGS)
    refused = by_name("libigl")
    small = [m for m in by_name("pymeshlab") if m.value >= len(case.faces)]
    assert len(refused) > 3 and len(small) > 1
    for method in refused:
        if method.value < len(case.faces):
            assert np.isnan(list(made.errors(case, method.run(case)).values())).all(), method
    for method in small:
        errors = made.errors(case, method.run(case))
        expected = {"distance": 0.0, "mean distance": 0.0, "faces": len(case.faces)}
        assert errors == pytest.approx(expected, abs=1e-9), method
    assert made.errors(case, by_name("pymeshlab")[0].run(case))["distance"] >= 0


def test_the_reference_is_converged(source):
    level = Surface(*decimate(source.vertices, source.faces, 1000))
    for one, other in ((source.surface, level), (level, source.surface)):
        mean, largest = distances(one, other)
        dense, _ = other.closest(sample(one.vertices, one.faces, 300_000))
        assert mean == pytest.approx(dense.mean(), rel=0.02)
        assert dense.max() <= 1.02 * largest
