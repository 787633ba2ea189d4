"""Small meshes: the same with their decimation put back in."""

import numpy as np
import pytest

from palpate.scene import SCENES, plan
from studies.omitted.meshes import Level, apart, leavings, misstated
from tests.studies.omitted.small_run import SETTINGS


@pytest.fixture(scope="module")
def found(run):
    folder, subject = run
    return {each.item: each for each in leavings(folder, [subject], SETTINGS)}


def test_every_part_has_a_leaving(found):
    assert set(found) == set(SCENES["mesh"])


@pytest.mark.parametrize("part", SCENES["mesh"])
def test_the_result_is_the_same(found, part):
    leaving = found[part]
    one, other = leaving.with_it(), leaving.without()
    assert len(other.faces) > 100 and leaving.left_out
    assert leaving.difference(one, other) <= leaving.bound


def test_what_is_stated_of_a_level_that_is_the_source_is_zero(found):
    stated = found["distance to the source"].without().stated
    assert stated["source_to_level"] == stated["level_to_source"] == {"mean": 0.0, "max": 0.0}


def test_differences_are_seen():
    vertices, faces = np.zeros((3, 3)), np.array([[0, 1, 2]])
    stated = {way: {"mean": 0.0, "max": 0.0} for way in ("source_to_level", "level_to_source")}
    level = Level(vertices, faces, stated)
    assert apart(level, level) == 0
    assert apart(level, level._replace(vertices=vertices + 1e-3)) == pytest.approx(1e-3)
    assert apart(level, level._replace(faces=faces[:, ::-1])) == np.inf
    assert apart(level, level._replace(vertices=np.zeros((4, 3)))) == np.inf
    worse = stated | {"level_to_source": {"mean": 0.0, "max": 0.25}}
    assert misstated(level, level._replace(stated=worse)) == 0.25


def test_only_small_meshes_are_left_out():
    assert not plan("mesh", faces=200, target=200).needs("decimation")
    assert plan("mesh", faces=201, target=200).kept["decimation"] == "201 faces, and at most 200 are asked for"
