"""Small meshes: the same with their decimation put back in."""

import numpy as np
import pytest
import trimesh

from palpate.mesh.decimate import collapse, decimate
from studies.omitted.meshes import ITEMS, Level, difference, omissions
from studies.omitted.omission import OMITTED
from tests.studies.omitted.small_run import SETTINGS


@pytest.fixture(scope="module")
def found(run):
    folder, subject = run
    return {each.item: each for each in omissions(folder, [subject], SETTINGS)}


def test_every_item_is_compared(found):
    assert set(found) == set(ITEMS) == {"decimation", "distance to the source"}


@pytest.mark.parametrize("item", ITEMS)
def test_the_result_is_the_same(found, item):
    omission = found[item]
    one, other = omission.with_it(), omission.without()
    assert len(other.faces) > 100 and omission.state == OMITTED
    assert omission.difference(one, other) <= omission.bound


def test_what_is_stated_of_a_level_that_is_the_source_is_zero(found):
    record = found["distance to the source"].without().record
    assert record["source_to_level"] == record["level_to_source"] == {"mean": 0.0, "max": 0.0}
    # With it, it was measured: what is measured of a surface against itself is rounding.
    assert 0 < found["distance to the source"].with_it().record["source_to_level"]["max"] < 1e-9


def test_differences_are_seen():
    vertices, faces = np.zeros((3, 3)), np.array([[0, 1, 2]])
    record = {way: {"mean": 0.0, "max": 0.0} for way in ("source_to_level", "level_to_source")}
    level = Level(vertices, faces, record)
    assert difference(level, level) == 0
    assert difference(level, level._replace(vertices=vertices + 1e-3)) == pytest.approx(1e-3)
    assert difference(level, level._replace(faces=faces[:, ::-1])) == np.inf
    assert difference(level, level._replace(vertices=np.zeros((4, 3)))) == np.inf
    worse = record | {"level_to_source": {"mean": 0.0, "max": 0.25}}
    assert difference(level, level._replace(record=worse)) == 0.25


def test_a_mesh_that_is_small_already_is_not_decimated():
    solid = trimesh.creation.box((0.04, 0.04, 0.45)).subdivide().subdivide()
    vertices, faces = np.float32(solid.vertices).astype(float), np.asarray(solid.faces, dtype=np.int64)
    same = decimate(vertices, faces, len(faces))
    assert same[0] is vertices and same[1] is faces
    collapsed = collapse(vertices, faces, len(faces))
    assert collapsed[0] is not vertices
    np.testing.assert_array_equal(collapsed[0], vertices)
    np.testing.assert_array_equal(collapsed[1], faces)
    assert len(decimate(vertices, faces, len(faces) // 2)[1]) <= len(faces) // 2


@pytest.mark.parametrize("seed", range(6))
def test_decimating_an_untidy_mesh_to_all_its_faces_changes_nothing(seed):
    """Holes, faces folded back, and faces across the solid: edges with three faces and more."""
    rng = np.random.default_rng(seed)
    ball = trimesh.creation.icosphere(subdivisions=2)
    faces = ball.faces[rng.random(len(ball.faces)) < 0.8]
    across = rng.permuted(np.tile(np.arange(len(ball.vertices)), (10, 1)), axis=1)[:, :3]
    faces = np.concatenate([faces, faces[:5, ::-1], across])
    used, faces = np.unique(faces, return_inverse=True)
    vertices = np.float32(ball.vertices[used]).astype(float)
    faces = faces.reshape(-1, 3).astype(np.int64)
    for count in (len(faces), 2 * len(faces)):
        found = collapse(vertices, faces, count)
        np.testing.assert_array_equal(found[0], vertices)
        np.testing.assert_array_equal(found[1], faces)
