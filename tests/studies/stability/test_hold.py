"""Cases of holding hold on a procedural object, and fail where the physics is spoilt."""

import numpy as np
import pytest

from palpate import shapes
from palpate.grasp.hold import HoldSimulation
from palpate.mesh import prepare
from studies.stability.cases import FAILS, HOLDS, examine
from studies.stability.hold import CASES
from studies.subjects import Subject


@pytest.fixture(scope="module")
def subject(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    prepare(shapes.write("knife", 1, folder / "source"), folder / "meshes")
    return Subject("knife-0001", "knife", "batch-0000", folder / "meshes")


@pytest.mark.parametrize("case", CASES, ids=str)
def test_cases_hold(case, subject):
    rows = examine("hold", case, subject)
    assert {row["verdict"] for row in rows} == {HOLDS}, [r for r in rows if r["verdict"] == FAILS]


def test_without_friction_nothing_is_carried(subject, monkeypatch):
    specification = HoldSimulation.specification

    def slippery(self, *arguments):
        self.friction = 0
        return specification(self, *arguments)

    monkeypatch.setattr(HoldSimulation, "specification", slippery)
    verdicts = [row["verdict"] for row in examine("hold", CASES[0], subject)]
    assert verdicts[::2] == [FAILS] * (len(verdicts) // 2)


def test_what_the_engine_cannot_simulate_fails(subject, monkeypatch):
    monkeypatch.setattr(HoldSimulation, "moved", lambda *arguments: np.nan)
    verdicts = [row["verdict"] for row in examine("hold", CASES[1], subject)]
    assert FAILS in verdicts and HOLDS not in verdicts
