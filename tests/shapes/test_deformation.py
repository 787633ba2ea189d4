"""Deformations against closed forms: volumes, lengths and angles of a bar."""

from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from palpate.shapes import read
from palpate.shapes.family import deformed

NONE = dict.fromkeys(read("rifle")["parameters"]["form"], 0.0)


def bar(**changes) -> trimesh.Trimesh:
    """A bar 20 x 40 x 200 mm along z, from z = 0, deformed; it bends towards y."""
    mesh = trimesh.creation.box((0.02, 0.04, 0.2)).apply_translation((0, 0, 0.1)).subdivide_to_size(0.004)
    moved = deformed(mesh.vertices, mesh.bounds, SimpleNamespace(**NONE | changes), (2, 1), seed=3)
    return trimesh.Trimesh(moved, mesh.faces, process=False)


def test_nothing_is_moved_without_a_deformation():
    assert np.allclose(bar().bounds, [[-0.01, -0.02, 0], [0.01, 0.02, 0.2]], atol=1e-12)


@pytest.mark.parametrize("changes", [{"twist": 40.0}, {"lean": 0.2}, {"bend": 60.0}])
def test_volume_stays(changes):
    """A twist and a shear keep it; a bend around the middle of the section does too, by Pappus."""
    assert bar(**changes).volume == pytest.approx(0.02 * 0.04 * 0.2, rel=2e-3)


def test_taper_scales_the_ends_and_not_the_middle():
    mesh = bar(taper=0.2, flare=0.1)
    top = mesh.vertices[np.isclose(mesh.vertices[:, 2], 0.2)]
    assert np.allclose(np.ptp(top[:, :2], axis=0), [0.02 * 1.2, 0.04 * 1.3])
    # The mean over the height of (1 + 0.2 s)(1 + 0.3 s), s from -1 to 1.
    assert mesh.volume == pytest.approx(0.02 * 0.04 * 0.2 * (1 + 0.2 * 0.3 / 3), rel=1e-3)


def test_a_bend_turns_the_end_faces_by_its_angle():
    mesh = bar(bend=60.0)
    ends = mesh.face_normals[np.abs(mesh.face_normals[:, 2]) > 0.8]
    up, down = ends[ends[:, 2] > 0].mean(axis=0), ends[ends[:, 2] < 0].mean(axis=0)
    assert np.degrees(np.arccos(-up @ down)) == pytest.approx(60, abs=0.1)


def test_lean_moves_the_end_and_keeps_the_ground():
    mesh = bar(lean=0.2)
    low, high = (mesh.vertices[np.isclose(mesh.vertices[:, 2], z)][:, 1] for z in (0, 0.2))
    assert low.mean() == pytest.approx(0, abs=1e-9) and high.mean() == pytest.approx(0.04)


@pytest.mark.parametrize("seed", range(8))
def test_stretch_and_warp_keep_the_order_of_points(seed):
    """At the largest amounts any class uses, no tetrahedron of a fine grid turns inside out."""
    steps = np.linspace(0, 1, 12)
    grid = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1)
    amounts = {"stretch_x": 0.3, "stretch_y": -0.3, "stretch_z": 0.3, "warp": 0.03, "taper": -0.1, "bend": 20.0}
    moved = deformed(
        grid.reshape(-1, 3), np.array([[0, 0, 0], [1, 1, 1.0]]), SimpleNamespace(**NONE | amounts), (2, 1), seed
    )
    moved = moved.reshape(grid.shape)
    edges = [np.diff(moved, axis=axis)[:11, :11, :11] for axis in range(3)]
    assert (np.linalg.det(np.stack(edges, axis=-1)) > 0).all()
