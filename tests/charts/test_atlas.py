"""The atlas against trimesh's topology, Euler's formula and the sphere itself."""

import itertools

import pytest
import torch
import trimesh

from palpate.charts import ATLAS_RADIUS, chart_faces, sphere, touch_chart, vision_atlas
from palpate.charts.atlas import radius_around, resized
from palpate.mesh import DIAGONAL, OBJECT_POSITION
from palpate.touch import PIXEL_CENTRES, SENSOR_WIDTH

CENTRE = torch.tensor(OBJECT_POSITION, dtype=torch.float64)


def as_trimesh(vertices, faces, process=False):
    return trimesh.Trimesh(vertices.double().numpy(), faces.numpy(), process=process)


def test_every_chart_is_a_disc_of_19_vertices_and_24_faces():
    atlas = vision_atlas()
    assert atlas.vertices.shape == (1824, 3) and atlas.faces.shape == (2304, 3)
    assert atlas.vertices.dtype == torch.float32 and atlas.faces.dtype == torch.int64
    assert (atlas.chart[atlas.faces] == atlas.chart[atlas.faces[:, :1]]).all()
    for chart, mesh in enumerate(as_trimesh(atlas.vertices, atlas.faces).split(only_watertight=False)):
        own = (atlas.chart == chart).nonzero()[:, 0]
        assert len(own) == 19 and len(mesh.vertices) == 19 and len(mesh.faces) == 24
        assert mesh.euler_number == 1 and mesh.body_count == 1 and mesh.is_winding_consistent
    assert chart == 95


def test_boundary_is_where_an_edge_has_one_face():
    atlas = vision_atlas()
    mesh = as_trimesh(atlas.vertices, atlas.faces)
    once = trimesh.grouping.group_rows(mesh.edges_sorted, require_count=1)
    assert set(mesh.edges_sorted[once].ravel().tolist()) == set(atlas.boundary.tolist())
    assert len(atlas.boundary) == 1152
    assert (torch.bincount(atlas.chart[atlas.boundary]) == 12).all()


def test_sphere_is_closed_and_faces_outwards():
    vertices, faces = sphere()
    mesh = as_trimesh(vertices, faces)
    assert vertices.shape == (1154, 3) and faces.shape == (2304, 3)
    assert len(vertices.unique(dim=0)) == 1154
    assert mesh.is_watertight and mesh.is_winding_consistent and mesh.body_count == 1
    assert len(vertices) - len(mesh.edges_unique) + len(faces) == 2
    assert len(mesh.edges_unique) == 3456
    outward = torch.from_numpy(mesh.triangles_center.copy()) - CENTRE
    assert ((torch.from_numpy(mesh.face_normals.copy()) * outward).sum(dim=1) > 0.95 * ATLAS_RADIUS).all()
    # An inscribed polyhedron with faces of a few centimetres has nearly the ball's volume.
    assert 0.985 < mesh.volume / (4 / 3 * torch.pi * ATLAS_RADIUS**3) < 1


def test_a_sphere_around_larger_and_smaller_objects():
    """The published one is around objects of 0.5 m; others are in proportion, in whole millimetres."""
    assert radius_around(DIAGONAL) == ATLAS_RADIUS
    for diagonal in (0.0123, 0.17, 1.9):
        assert 0.52 * diagonal <= radius_around(diagonal) < 0.52 * diagonal + 0.001
    start = vision_atlas().vertices
    assert torch.equal(resized(start, ATLAS_RADIUS), start)
    moved = resized(start, 0.05).double() - CENTRE
    assert (moved.norm(dim=1) - 0.05).abs().max() < 1e-7
    assert (moved / 0.05 - (start.double() - CENTRE) / ATLAS_RADIUS).abs().max() < 5e-6


@pytest.mark.parametrize("vertices", [vision_atlas().vertices, sphere()[0]])
def test_all_vertices_lie_on_the_sphere(vertices):
    radius = (vertices.double() - CENTRE).norm(dim=1)
    assert (radius - ATLAS_RADIUS).abs().max() < 1e-7


def test_atlas_is_the_sphere_cut_along_the_charts_sides():
    atlas, (vertices, faces) = vision_atlas(), sphere()
    assert torch.equal(atlas.vertices, vertices[atlas.position])
    assert torch.equal(atlas.position[atlas.faces], faces)
    # trimesh merges by position, knowing nothing of how the charts were made.
    merged = as_trimesh(atlas.vertices, atlas.faces, process=True)
    assert len(merged.vertices) == 1154 and merged.is_watertight and merged.euler_number == 2


def test_joined_are_all_pairs_of_coincident_vertices_of_different_charts():
    atlas = vision_atlas()
    where = {}
    for vertex, at in enumerate(atlas.vertices.tolist()):
        where.setdefault(tuple(at), []).append(vertex)
    expected = {pair for together in where.values() for pair in itertools.combinations(together, 2)}
    pairs = [tuple(sorted(pair)) for pair in atlas.joined.tolist()]
    assert set(pairs) == expected and len(pairs) == len(expected)
    assert (atlas.chart[atlas.joined[:, 0]] != atlas.chart[atlas.joined[:, 1]]).all()
    # 432 side vertices between two charts; 6 corners of four charts and 44 of six.
    assert len(pairs) == 432 + 6 * 6 + 44 * 15


def test_charts_are_about_equally_large():
    atlas = vision_atlas()
    area = torch.from_numpy(as_trimesh(atlas.vertices, atlas.faces).area_faces.copy())
    charts = area.reshape(96, 24).sum(dim=1)
    assert (charts / charts.mean() - 1).abs().max() < 0.13
    assert area.min() > 0.6 * area.mean() and area.max() < 1.4 * area.mean()


def test_touch_chart_covers_the_sensor_in_the_readings_order():
    chart = touch_chart()
    assert chart.grid.shape == (81, 2) and chart.faces.shape == (128, 3) and chart.centre == 40
    y, z = chart.grid.double().reshape(9, 9, 2).unbind(dim=2)
    assert (y.diff(dim=1) > 0).all() and (y.diff(dim=0) == 0).all()
    assert (z.diff(dim=0) > 0).all() and (z.diff(dim=1) == 0).all()
    assert chart.grid[40].abs().max() < 1e-9
    mesh = as_trimesh(torch.cat([torch.zeros(81, 1), chart.grid], dim=1), chart.faces)
    assert mesh.area == pytest.approx(SENSOR_WIDTH**2, rel=1e-6)
    assert mesh.euler_number == 1 and (mesh.face_normals @ [-1, 0, 0]).min() > 0.999
    # The pixels' centres lie half a pixel inside.
    assert y.max().item() == pytest.approx(PIXEL_CENTRES[-1] + SENSOR_WIDTH / 200, abs=1e-8)


def test_touch_charts_follow_the_vision_charts():
    faces = chart_faces(2)
    assert torch.equal(faces[:2304], vision_atlas().faces)
    assert torch.equal(faces[2304:2432], touch_chart().faces + 1824)
    assert torch.equal(faces[2432:], touch_chart().faces + 1905)
