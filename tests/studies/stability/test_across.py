"""Cases of grasps across an object: the short one holds, and fails where the grip is not reached."""

import pytest

from palpate.grasp.hold import GripSimulation
from studies.stability.across import CASES, OBJECTS, tried
from studies.stability.cases import FAILS, HOLDS, examine

SHORT = [case for case in CASES if case.short]


@pytest.mark.parametrize("case", SHORT, ids=str)
def test_cases_hold(case):
    rows = examine("across", case, None)
    assert {row["verdict"] for row in rows} == {HOLDS}, [row for row in rows if row["verdict"] == FAILS]


def test_a_ball_is_held_and_a_blade_below_the_jaws_least_opening_is_refused_with_the_reason():
    held, moved, deepest = tried(OBJECTS["ball"], 0.8, 0.1, 0.004)
    assert held["holds"] == sum(held.values()) and max(moved) < 0.02 and 0 < deepest < 0.001
    assert set(tried(OBJECTS["blade of 2 mm"], 0.8, 0.1, 0.004)[0]) == {"touches from one side only"}


def test_servos_that_press_by_their_way_miss_the_grip(monkeypatch):
    monkeypatch.setattr(GripSimulation, "_press", lambda *arguments: None)
    verdicts = {row["verdict"] for row in examine("across", SHORT[0], None)}
    assert FAILS in verdicts
