"""Grasps: each part in and out; what changes where fingers end is not left out as a saving."""

import numpy as np
import pytest

from palpate.grasp.closing import GraspScene
from palpate.scene import SCENES, plan
from studies.omitted import grasps as left_out
from tests.studies.omitted.small_run import SETTINGS

DEFAULT = plan("grasp")
FINGERS_CHANGE = {*DEFAULT.unmodelled, "self-collision"}


@pytest.fixture(scope="module")
def found(run):
    folder, subject = run
    return {each.part: each for each in left_out.leavings(folder, [subject], SETTINGS)}


@pytest.fixture(scope="module")
def scene(run):
    return left_out.scene_of(*run, SETTINGS["grasps"]["timestep"])


def test_every_part_has_a_leaving(found):
    assert set(found) == set(SCENES["grasp"])
    assert all(each.left_out == (part in DEFAULT.left_out) for part, each in found.items())


@pytest.mark.parametrize("part", sorted(set(SCENES["grasp"]) - FINGERS_CHANGE))
def test_the_result_is_the_same(found, part):
    leaving = found[part]
    one, other = leaving.with_it(), leaving.without()
    assert leaving.difference(one, other) <= leaving.bound
    assert leaving.bound == 0 or part in left_out.BOUNDS


@pytest.mark.parametrize("part", sorted(FINGERS_CHANGE))
def test_what_changes_the_result_is_kept_or_said_to_be_a_choice(found, part):
    leaving = found[part]
    assert not leaving.left_out
    assert leaving.difference(leaving.with_it(), leaving.without()) > 0.1  # degrees


def test_fingers_are_stopped_by_the_object(scene):
    """Else there would be nothing that parts could change."""
    there = left_out.ends(GraspScene(scene.hand, scene.patches), scene)
    nothing = left_out.ends(GraspScene(scene.hand, []), scene)
    assert left_out.turned(there, nothing) > 5


def test_with_all_that_is_left_out_put_in_at_once_the_joints_end_at_the_same_angles(scene):
    everything = GraspScene(scene.hand, scene.patches, plan=DEFAULT.including(), visual=scene.visual)
    one, other = left_out.ends(everything, scene), left_out.ends(GraspScene(scene.hand, scene.patches), scene)
    assert left_out.turned(one, other) < left_out.GIVING_WAY


def test_a_held_object_gives_way_less_than_a_tenth_of_a_micrometre(scene):
    engine = GraspScene(scene.hand, scene.patches, plan=DEFAULT.including("object degrees of freedom"))
    left_out.ends(engine, scene)
    assert engine.data.ncon > 0
    assert 0 < np.abs(engine.data.qpos[-7:-4]).max() < 1e-7


def test_a_loose_object_is_pushed_away(scene):
    engine = GraspScene(scene.hand, scene.patches, plan=DEFAULT.including("loose object"))
    left_out.ends(engine, scene)
    assert np.abs(engine.data.qpos[-7:-4]).max() > 1e-3
