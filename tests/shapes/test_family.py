"""What every procedural object must be: closed, distinct, in its pose, in bounds, the same every time."""

import hashlib
from functools import cache

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import Delaunay

from palpate.shapes import CLASSES, make, style
from palpate.surface.embree import RayMesh

# Real objects' largest extent, metres.
LARGEST = {"bottle": (0.05, 0.4), "knife": (0.1, 0.6), "cellphone": (0.08, 0.35), "rifle": (0.6, 1.7)}


made = cache(make)  # for tests that share an object, and only look at it


def digest(scene: trimesh.Scene) -> str:
    total = hashlib.sha256()
    for name, mesh in scene.geometry.items():
        total.update(name.encode() + mesh.vertices.tobytes() + mesh.faces.tobytes())
    return total.hexdigest()


def check(class_name: str, scene: trimesh.Scene) -> None:
    for name, mesh in scene.geometry.items():
        assert mesh.is_watertight and mesh.is_winding_consistent, name
        assert mesh.volume > 0, name
        welded = trimesh.Trimesh(np.float32(mesh.vertices), mesh.faces, process=False)
        welded.merge_vertices()
        assert welded.is_watertight, name
        assert np.isfinite(mesh.vertices).all() and np.isfinite(mesh.visual.uv).all(), name
        assert mesh.visual.uv.shape == (len(mesh.vertices), 2), name
        assert mesh.visual.uv.min() >= -1e-9 and mesh.visual.uv.max() <= 1 + 1e-9, name
    assert 5_000 <= sum(len(mesh.faces) for mesh in scene.geometry.values()) <= 50_000
    x, y, z = scene.extents
    low, high = LARGEST[class_name]
    assert low <= max(x, y, z) <= high
    # Bottles and phones stand, knives and rifles lie along y on their edge.
    assert {"bottle": z > max(x, y), "cellphone": z > max(x, y), "knife": y > z > x, "rifle": y > z > x}[class_name]


# The first object of each style.
FIRST = {name: {style(name, index): index for index in reversed(range(300))} for name in CLASSES}
EVERY_STYLE = [(name, index) for name in CLASSES for index in FIRST[name].values()]


@pytest.mark.parametrize(("class_name", "index"), EVERY_STYLE)
def test_every_style_is_closed_posed_and_in_bounds(class_name, index):
    check(class_name, made(class_name, index))


@given(st.sampled_from(CLASSES), st.integers(0, 5000), st.integers(0, 2**31))
@settings(max_examples=40, deadline=None)
def test_any_index_and_seed_gives_a_usable_object(class_name, index, seed):
    check(class_name, make(class_name, index, seed))


@pytest.mark.parametrize("class_name", CLASSES)
def test_objects_of_a_style_are_distinct(class_name):
    """Volumes and proportions of objects of one style differ."""
    first = style(class_name, 0)
    alike = [index for index in range(300) if style(class_name, index) == first][:6]
    scenes = [made(class_name, index) for index in alike]
    shapes = [[*scene.extents / np.linalg.norm(scene.extents), scene.volume * 1e6] for scene in scenes]
    assert len({tuple(np.round(shape, 3)) for shape in shapes}) == 6


@pytest.mark.parametrize("class_name", CLASSES)
def test_same_arguments_same_object_and_another_seed_another_object(class_name):
    assert digest(make(class_name, 3, 7)) == digest(make(class_name, 3, 7))
    assert digest(make(class_name, 3, 7)) != digest(make(class_name, 3, 8))


@pytest.mark.parametrize("class_name", CLASSES)
def test_several_materials_and_colours(class_name):
    materials = [[mesh.visual.material for mesh in made(class_name, index).geometry.values()] for index in range(12)]
    assert np.median([len(found) for found in materials]) >= 2
    assert len({tuple(m.baseColorFactor) for found in materials for m in found}) >= 8
    assert any(m.baseColorTexture is not None for found in materials for m in found)


@pytest.mark.parametrize("index", range(16))
def test_a_bottle_stands(index):
    """It rests on z = 0, its centre of mass above what rests there."""
    mesh = made("bottle", index).to_geometry()
    vertices = mesh.vertices - [0, 0, mesh.bounds[0, 2]]
    assert abs(mesh.bounds[0, 2]) < 0.002
    foot = Delaunay(vertices[vertices[:, 2] < 0.0005, :2])
    assert foot.find_simplex(mesh.center_mass[:2]) >= 0


def test_a_knife_is_thin_where_it_cuts():
    """Rays across the blade: it is under 6 mm thick in front of the handle, and thinner at the edge."""
    scene = made("knife", 0)
    steel = next(m for m in scene.geometry.values() if m.bounds[1, 1] > 0.1)
    vertices = steel.vertices[(steel.vertices[:, 1] > 0.03) & (steel.vertices[:, 1] < 0.1)]
    assert np.ptp(vertices[:, 0]) < 0.006
    edge = vertices[vertices[:, 2] < vertices[:, 2].min() + 1e-4]
    assert np.ptp(edge[:, 0]) < 0.001


@pytest.mark.parametrize("name", ["smart", "touch", "bar", "keyboard", "brick", "slider"])
def test_a_phone_screen_faces_plus_x(name):
    """From far along +x the phone shows its screen: nothing else is before it."""
    scene = made("cellphone", FIRST["cellphone"][name])
    screen, ahead = scene.geometry["screen"], np.array([1.0, 0, 0])
    lit = screen.face_normals @ ahead > 0.5
    assert screen.area_faces[lit].sum() > 0.4 * screen.area
    mesh = RayMesh(scene.to_geometry())
    origins = screen.triangles_center[lit] + ahead
    hit = mesh.first_face(origins, -ahead[None])
    depth = origins[:, 0] - mesh.triangles[hit, :, 0].mean(axis=1)
    assert (np.abs(depth - 1) < 0.003).mean() > 0.97


def test_unknown_classes_and_negative_indices_are_refused():
    with pytest.raises(ValueError, match="choose from bottle"):
        make("spoon", 0)
    with pytest.raises(ValueError, match="negative"):
        make("bottle", -1)
