"""The short cases of touch hold, and each fails without the code that guards it."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from palpate.touch import rays as caster
from palpate.touch import reading, shading
from studies.stability import rays
from studies.stability.cases import FAILS, HOLDS, REJECTED, examine
from studies.subjects import Subject

SHORT = {case.name: case for case in rays.CASES if case.short}


@pytest.fixture(scope="module")
def subject(tmp_path_factory):
    """A knife-like object: a ball with a thin plate through it."""
    folder = tmp_path_factory.mktemp("subject")
    plate = trimesh.creation.box((0.3, 0.04, 0.002)).subdivide().subdivide()
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.03)
    (folder / "visual.glb").write_bytes(trimesh.Scene([plate, ball]).export(file_type="glb"))
    return Subject("object", "class", "batch", folder)


@pytest.mark.parametrize("name", SHORT)
def test_holds(name, subject):
    rows = examine("rays", SHORT[name], subject)
    assert not [row for row in rows if row["verdict"] == FAILS]
    assert {row["verdict"] for row in rows} <= {HOLDS, REJECTED}


def unlimited(self, *arguments):
    """Depth without the sensor's range."""
    return self.depth(*arguments)


def too_bright(height, normal, kind):
    return light_of(height, normal, replace(kind, diffuse=400.0))


light_of = shading.light_of
NAIVE = {
    "grazing sensor": (caster, "_NO_WIDTH", 0.1),
    "rays through vertices and along edges": (caster, "_pits", lambda depth, pixel: np.zeros(depth.shape, dtype=bool)),
    "sensor plane inside the mesh": (caster, "_EDGE_ON", 0.0),
    "surface on the sensor plane": (caster, "_SLACK", 0.0),
    "surface exactly at the range limit": (caster.RayCaster, "_in_range", unlimited),
    "steep steps in the impression": (shading, "light_of", too_bright),
    "float32 far from the origin": (reading, "FURTHEST", np.inf),
    "object much larger than the sensor": (caster, "_LARGEST", np.inf),
}


@pytest.mark.parametrize("name", NAIVE)
def test_fails_without_its_guard(name, subject, monkeypatch):
    monkeypatch.setattr(*NAIVE[name])
    with np.errstate(all="ignore"):
        assert any(finding.verdict == FAILS for finding in SHORT[name].examine(subject))


def test_disagreement_is_seen():
    pose = rays.random_pose(2)
    mesh = rays.in_pose(rays.sheet(0.01), pose)
    depth = np.full((100, 100), 0.01)
    assert rays.disagreement(depth, mesh.triangles, pose) == pytest.approx((0, 0), abs=1e-9)
    depth[3, 4], depth[5, 6] = np.inf, 0.011
    assert rays.disagreement(depth, mesh.triangles, pose) == pytest.approx((1, 1.0), abs=1e-9)
    depth[:] = np.inf
    assert rays.disagreement(depth, mesh.triangles, pose).flipped == 10_000
    assert rays.disagreement(depth, mesh.triangles[:0], pose).flipped == 0
