"""Grasps: each item in and out; what changes where fingers end is not omitted as a saving."""

import numpy as np
import pytest

from palpate.grasp.closing import GraspSimulation
from studies.omitted import grasps
from studies.omitted.grasps import CHECK_ITEMS, ITEMS
from studies.omitted.omission import OMITTED
from tests.studies.omitted.small_run import SETTINGS

OMITTED_ITEMS = [item for item, row in ITEMS.items() if row["state"] == OMITTED]


@pytest.fixture(scope="module")
def found(run):
    folder, subject = run
    return {each.item: each for each in grasps.omissions(folder, [subject], SETTINGS)}


@pytest.fixture(scope="module")
def case(run):
    return grasps.load_case(*run, SETTINGS["grasps"]["timestep"])


def test_every_item_is_compared(found):
    assert set(found) == {*ITEMS, *CHECK_ITEMS} and len(found) == 12
    assert {item for item, each in found.items() if each.state == OMITTED} == {*OMITTED_ITEMS, *CHECK_ITEMS}


@pytest.mark.parametrize("item", [*OMITTED_ITEMS, *CHECK_ITEMS])
def test_the_result_is_the_same(found, item):
    omission = found[item]
    one, other = omission.with_it(), omission.without()
    assert omission.difference(one, other) <= omission.bound
    assert omission.bound == {"gravity": 1e-6, "object degrees of freedom": 0.01}.get(item, 0)


@pytest.mark.parametrize("item", sorted(set(ITEMS) - set(OMITTED_ITEMS)))
def test_what_changes_the_result_is_kept_or_said_to_be_a_choice(found, item):
    omission = found[item]
    assert omission.when.startswith("never: " if item == "self-collision" else "always, by choice of the model, not")
    assert omission.difference(omission.with_it(), omission.without()) > 0.1  # degrees


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
    assert grasps.joint_difference(one, other) < ITEMS["object degrees of freedom"]["bound"]


def test_a_held_object_gives_way_less_than_a_tenth_of_a_micrometre(case):
    simulation = grasps.changed_simulation(case, "object degrees of freedom")
    grasps.final_joints(simulation, case)
    assert simulation.data.ncon > 0
    assert 0 < np.abs(simulation.data.qpos[-7:-4]).max() < 1e-7


def test_a_loose_object_is_pushed_away(case):
    simulation = grasps.changed_simulation(case, "loose object")
    grasps.final_joints(simulation, case)
    assert np.abs(simulation.data.qpos[-7:-4]).max() > 1e-3
