"""The short cases of losses and training hold on a tube, and some fail without the code that guards them."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from palpate.learning import loop
from studies.stability.cases import FAILS, examine
from studies.stability.losses import CASES, small_data
from studies.subjects import Subject

SHORT = [case for case in CASES if case.short]


@pytest.fixture(scope="module")
def subject(tmp_path_factory) -> Subject:
    """A tube of 0.5 m diagonal."""
    folder = tmp_path_factory.mktemp("object")
    tube = trimesh.creation.annulus(r_min=0.05, r_max=0.12, height=0.37, sections=48)
    trimesh.Trimesh(tube.vertices, tube.faces).export(folder / "collision.ply")
    return Subject("tube", "tube", "batch-0000", folder)


@pytest.mark.parametrize("case", SHORT, ids=str)
def test_nothing_fails(subject, case):
    rows = examine("losses", case, subject)
    assert rows and not [row for row in rows if row["verdict"] == FAILS]


def test_all_names_differ():
    assert len({case.name for case in CASES}) == len(CASES)


def fails(name, subject):
    case = next(case for case in CASES if case.name == name)
    return [row["quantity"] for row in examine("losses", case, subject) if row["verdict"] == FAILS]


def test_clouds_are_of_the_object(subject):
    data = small_data(subject)
    radius = np.linalg.norm(data["points"][0][:, :2], axis=1)
    assert radius.min() > 0.0495 and radius.max() < 0.1205
    outside = data["charts"][0, ..., 0].size
    assert outside == 5 * 4 * 81 and data["success"].all()
    # The charts' middles lie on the surface: a distance to a sample of it.
    middles = data["charts"][0, :, :, 40].reshape(-1, 3)
    assert cKDTree(data["points"][0]).query(middles)[0].max() < 1e-6


def test_a_training_that_does_not_look_would_be_seen(subject, monkeypatch):
    monkeypatch.setattr(loop, "math", SimpleNamespace(**vars(math) | {"isfinite": lambda _: True}))
    assert "infinite gradient" in fails("a step whose loss or gradient is not finite", subject)
