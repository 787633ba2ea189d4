"""Decimation: the surface stays where it is, measured by MeshLab."""

import numpy as np
import pymeshlab
import pytest
import trimesh

from palpate.mesh.decimate import MAX_DEVIATION, collapsed, decimate
from palpate.mesh.part import distinct

ASKED = 800


def sheets(count=8, side=30):
    """Bent sheets of 0.3 m that meet in one line, as pages in a spine: each edge there has `count` faces."""
    u, v = np.meshgrid(*[np.linspace(0, 1, side)] * 2, indexing="ij")
    index = np.arange(side * side).reshape(side, side)
    corners = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate(
        [np.stack([corners[i] for i in triple], -1).reshape(-1, 3) for triple in ((0, 1, 2), (0, 2, 3))]
    )
    pages = []
    for page in range(count):
        angle, height = 2 * np.pi * page / count, 0.02 * np.sin(5 * np.pi * u + page) * u * np.cos(3 * np.pi * v)
        x, y = u * np.cos(angle) - height * np.sin(angle), u * np.sin(angle) + height * np.cos(angle)
        pages.append(0.3 * np.stack([x, y, v], -1).reshape(-1, 3))
    places = np.concatenate(pages).astype(np.float32).astype(float)
    first, number = distinct(*places.T)
    return places[first], number[np.concatenate([faces + side * side * page for page in range(count)])]


def off(one, other):
    """The largest distance of points on one mesh to the other, m, by MeshLab."""
    meshes = pymeshlab.MeshSet(verbose=False)
    for mesh in (one, other):
        meshes.add_mesh(pymeshlab.Mesh(*mesh))
    return meshes.get_hausdorff_distance(
        sampledmesh=0, targetmesh=1, samplevert=True, sampleface=True, samplenum=20000, maxdist=pymeshlab.PureValue(1)
    )["max"]


def test_a_surface_that_would_move_keeps_more_faces():
    source = sheets()
    assert off(source, collapsed(*source, ASKED)) > 1.5 * MAX_DEVIATION
    level = decimate(*source, ASKED)
    assert ASKED < len(level[1]) < len(source[1])
    assert max(off(source, level), off(level, source)) < 1.1 * MAX_DEVIATION


def test_another_keeps_what_was_asked_for():
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.1)
    source = np.array(ball.vertices), np.array(ball.faces)
    for made, expected in zip(decimate(*source, 2000), collapsed(*source, 2000), strict=True):
        np.testing.assert_array_equal(made, expected)
    assert len(decimate(*source, 2000)[1]) == 2000


@pytest.mark.parametrize("count", [4, 100])
def test_in_the_end_it_stays_as_it_is(count, monkeypatch):
    source = sheets(3, 6)
    monkeypatch.setattr("palpate.mesh.decimate.MAX_DEVIATION", -1.0)
    assert all(made is given for made, given in zip(decimate(*source, count), source, strict=True))
