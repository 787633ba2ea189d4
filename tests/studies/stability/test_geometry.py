"""The short cases of geometry hold, and fail without the code that guards them."""

import numpy as np
import pytest
import trimesh

from palpate.mesh import build, decimate
from palpate.mesh import repair as repairs
from studies.stability import geometry
from studies.stability.cases import FAILS, HOLDS, REJECTED, examine

SHORT = {case.name: case for case in geometry.CASES if case.short}


@pytest.mark.parametrize("name", SHORT)
def test_holds(name):
    rows = examine("geometry", SHORT[name], None)
    assert not [row for row in rows if row["verdict"] == FAILS]
    assert {row["verdict"] for row in rows} <= {HOLDS, REJECTED}


def thinning(vertices, faces, count):
    """A decimation that lets the two sides of a blade fall into one."""
    return vertices * [1, 1, 0.5], faces


def whole(mesh, cell=None, thickness=None):
    """Contact geometry that is the object's convex hull."""
    return [np.asarray(mesh.vertices)]


def all_thin(vertices, faces, keep, tolerance):
    """Thin faces dropped also from closed surfaces."""
    side = vertices[np.roll(faces, -1, axis=1)] - vertices[faces]
    height = np.linalg.norm(np.cross(side[:, 0], side[:, 1]), axis=1) / np.linalg.norm(side, axis=2).max(axis=1)
    return keep & (height <= tolerance)


NAIVE = {
    "blade of 0.2 mm": (build, "decimate", thinning),
    "sheet without thickness": (repairs, "_doubled", lambda vertices, faces, merged, among, tolerance: ~among),
    "slivers of aspect 1e6": (repairs, "_droppable", all_thin),
    "hole narrower than a finger": (geometry, "surface_patches", whole),
    "deep concavity": (geometry, "surface_patches", whole),
}


@pytest.mark.parametrize("name", NAIVE)
def test_fails_without_its_guard(name, monkeypatch):
    monkeypatch.setattr(*NAIVE[name])
    assert FAILS in [row["verdict"] for row in examine("geometry", SHORT[name], None)]


def test_decimation_of_a_blade_goes_through_decimate():
    assert build.decimate is decimate.decimate  # so that the patch above is of what is used


def test_clearance_of_a_box():
    box = np.asarray(trimesh.creation.box((2, 2, 2)).vertices)
    points = np.array([(3.0, 0, 0), (0, 0, 5.0)])
    assert geometry.clearance([box], points) == pytest.approx(2)
    assert geometry.clearance([box, box + 10], np.zeros((1, 3))) == pytest.approx(-1)
