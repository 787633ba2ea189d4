"""Patch hulls cover the surface and hardly stick out of it, whatever the mesh."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from palpate.grasp.closing import GraspSimulation
from palpate.grasp.patches import CELL, THICKNESS, split_long_edges, surface_patches
from palpate.hand import allegro


def shapes():
    hollow = trimesh.creation.annulus(r_min=0.08, r_max=0.1, height=0.3)
    open_box = trimesh.creation.box((0.1, 0.2, 0.3))
    open_box.update_faces(np.arange(12) > 1)
    return {
        "box": trimesh.creation.box((0.1, 0.2, 0.3)),
        "ball": trimesh.creation.icosphere(subdivisions=3, radius=0.1),
        "tube": hollow,
        "open": open_box,
    }


def planes_of(patches):
    return [ConvexHull(patch, qhull_options="QJ").equations for patch in patches]


@pytest.mark.parametrize("name", ["box", "ball", "tube", "open"])
def test_every_surface_point_is_in_a_patch(name):
    mesh = shapes()[name]
    points, _ = trimesh.sample.sample_surface(mesh, 1000, seed=0)
    outside = np.full(len(points), np.inf)
    for planes in planes_of(surface_patches(mesh)):
        outside = np.minimum(outside, (points @ planes[:, :3].T + planes[:, 3]).max(axis=1))
    assert outside.max() < 1e-6


@pytest.mark.parametrize("name", ["box", "ball", "open"])
def test_patches_of_a_convex_surface_do_not_stick_out(name):
    mesh = shapes()[name]
    planes = ConvexHull(mesh.vertices).equations
    corners = np.concatenate(surface_patches(mesh))  # a hull sticks out no further than its corners
    assert (corners @ planes[:, :3].T + planes[:, 3]).max() < 1e-9


def test_patches_stick_out_of_a_hollow_by_a_cells_sagitta():
    inner, sides = 0.08, 32
    widest = 1.5 * CELL  # a cell and the triangles, of half a cell, that reach out of it
    sagitta = widest**2 / 8 / inner
    polygon = inner * np.cos(np.pi / sides)  # the tube's mesh has 32 sides
    worst = 0.0
    for patch in surface_patches(shapes()["tube"]):
        hull = trimesh.Trimesh(patch, ConvexHull(patch, qhull_options="QJ").simplices, process=False)
        points, _ = trimesh.sample.sample_surface(hull, 60, seed=0)
        worst = max(worst, polygon - np.hypot(points[:, 0], points[:, 1]).min())
    assert 0 < worst < sagitta


def test_patches_of_a_plate_thinner_than_their_thickness_stick_out_by_less_than_it():
    thin = 0.0005
    plate = trimesh.creation.box((0.2, 0.1, thin))
    reach = max(np.abs(patch[:, 2]).max() for patch in surface_patches(plate))
    assert reach <= thin / 2 + (THICKNESS - thin) + 1e-12


def test_splitting_keeps_the_surface_and_shortens_the_edges():
    mesh = trimesh.creation.cone(radius=0.1, height=0.4, sections=7)
    pieces = split_long_edges(mesh.triangles, 0.01)
    edges = np.linalg.norm(np.roll(pieces, -1, axis=1) - pieces, axis=2)
    assert edges.max() <= 0.01
    assert trimesh.triangles.area(pieces).sum() == pytest.approx(mesh.area)
    # Winding is kept: the normals enclose the same volume.
    assert trimesh.triangles.mass_properties(pieces)["volume"] == pytest.approx(mesh.volume)


def test_a_hair_makes_no_patch_and_the_model_compiles():
    box = trimesh.creation.box((0.05, 0.05, 0.05))
    for width in (1e-3, 1e-6, 1e-12, 0.0):
        hair = [[0.1, 0, 0], [0.11, 0, 0], [0.105, width, 0]]
        both = trimesh.Trimesh(np.vstack([box.vertices, hair]), np.vstack([box.faces, [[8, 9, 10]]]), process=False)
        patches = surface_patches(both)
        assert len(patches) == len(surface_patches(box)) + (width == 1e-3)
        assert GraspSimulation(allegro(), patches).model.nmesh == len(patches)
    assert surface_patches(trimesh.Trimesh(hair, [[0, 1, 2]], process=False)) == []


def test_degenerate_faces_make_no_patch():
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    faces = np.vstack([box.faces, [[0, 0, 1], [2, 2, 2]]])
    dirty = trimesh.Trimesh(box.vertices, faces, process=False, validate=False)
    clean = surface_patches(trimesh.Trimesh(box.vertices, box.faces, process=False))
    for one, other in zip(surface_patches(dirty), clean, strict=True):
        np.testing.assert_allclose(one, other)
