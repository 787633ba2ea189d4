"""Grasps: each item in and out; what changes where fingers end is not omitted as a saving."""

import numpy as np
import pytest

from palpate.grasp.closing import GraspSimulation
from studies.omitted import grasps
from studies.omitted.grasps import CHECK_ITEMS, ITEMS, KEPT_ITEMS, NOT_MODELLED_ITEMS, OMITTED_ITEMS
from studies.omitted.omission import NOT_MODELLED, OMITTED, STAYS
from tests.studies.omitted.small_run import SETTINGS

FINGERS_CHANGE = {*NOT_MODELLED_ITEMS, "self-collision"}


@pytest.fixture(scope="module")
def found(run):
    folder, subject = run
    return {each.item: each for each in grasps.omissions(folder, [subject], SETTINGS)}


@pytest.fixture(scope="module")
def case(run):
    return grasps.load_case(*run, SETTINGS["grasps"]["timestep"])


def test_every_item_is_compared(found):
    assert set(found) == set(ITEMS) and len(ITEMS) == 13
    assert {item for item, each in found.items() if each.state == OMITTED} == {*OMITTED_ITEMS, *CHECK_ITEMS}


@pytest.mark.parametrize("item", sorted(set(ITEMS) - FINGERS_CHANGE))
def test_the_result_is_the_same(found, item):
    omission = found[item]
    one, other = omission.with_it(), omission.without()
    assert omission.difference(one, other) <= omission.bound
    assert omission.bound == 0 or item in grasps.BOUNDS


@pytest.mark.parametrize("item", sorted(FINGERS_CHANGE))
def test_what_changes_the_result_is_kept_or_said_to_be_a_choice(found, item):
    omission = found[item]
    assert omission.state == (NOT_MODELLED if item in NOT_MODELLED_ITEMS else STAYS)
    assert omission.difference(omission.with_it(), omission.without()) > 0.1  # degrees


def test_when_says_why_an_item_is_kept_or_not_modelled():
    assert {grasps.when(item) for item in (*OMITTED_ITEMS, *CHECK_ITEMS)} == {"always"}
    assert all(grasps.when(item) == f"never: {why}" for item, why in KEPT_ITEMS.items())
    assert grasps.when("friction").startswith("always, by choice of the model, not as a saving: fingers slide")


def test_fingers_are_stopped_by_the_object(case):
    """Else there would be nothing that an item could change."""
    there = grasps.final_joints(GraspSimulation(case.hand, case.patches), case)
    nothing = grasps.final_joints(GraspSimulation(case.hand, []), case)
    assert grasps.joint_difference(there, nothing) > 5


def test_with_all_that_is_omitted_put_in_at_once_the_joints_end_at_the_same_angles(case):
    everything = grasps.changed_simulation(case, *OMITTED_ITEMS)
    one, other = (
        grasps.final_joints(everything, case),
        grasps.final_joints(GraspSimulation(case.hand, case.patches), case),
    )
    assert grasps.joint_difference(one, other) < grasps.GIVING_WAY


def test_a_held_object_gives_way_less_than_a_tenth_of_a_micrometre(case):
    simulation = grasps.changed_simulation(case, "object degrees of freedom")
    grasps.final_joints(simulation, case)
    assert simulation.data.ncon > 0
    assert 0 < np.abs(simulation.data.qpos[-7:-4]).max() < 1e-7


def test_a_loose_object_is_pushed_away(case):
    simulation = grasps.changed_simulation(case, "loose object")
    grasps.final_joints(simulation, case)
    assert np.abs(simulation.data.qpos[-7:-4]).max() > 1e-3
