"""Lathing, lofting and plates against closed forms, and CSG against set algebra of volumes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.shapes.solids import (
    along_y,
    box,
    closed,
    cut,
    filleted,
    fluted,
    lathe,
    loft,
    prism,
    rod,
    slab,
    superellipse,
    sweep,
    turned,
    union,
    upright,
)

SEGMENTS = 64
# A regular polygon's area over its circumscribed circle's.
POLYGON = SEGMENTS / (2 * np.pi) * np.sin(2 * np.pi / SEGMENTS)


def area(polygon: np.ndarray) -> float:
    x, y = polygon.T
    return abs(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) / 2


@given(
    st.lists(st.tuples(st.floats(0.01, 0.2), st.floats(0.005, 0.1)), min_size=2, max_size=8),
)
@settings(max_examples=40, deadline=None)
def test_lathe_volume_by_pappus(steps):
    """Volume = area x path of the centroid, summed over the trapezoids of the profile (truncated cones)."""
    radius = np.array([r for r, _ in steps])
    z = np.cumsum([dz for _, dz in steps])
    cones = np.pi / 3 * np.diff(z) * (radius[:-1] ** 2 + radius[:-1] * radius[1:] + radius[1:] ** 2)
    solid = lathe(np.column_stack([radius, z]), SEGMENTS)
    assert solid.volume() == pytest.approx(POLYGON * cones.sum(), rel=1e-5)


def test_a_lathed_ring_is_a_torus():
    """Pappus again, with a profile off the axis: 2 pi R times the area."""
    angle = np.linspace(0, 2 * np.pi, 41)[:-1]
    section = 0.01 * np.column_stack([np.cos(angle), np.sin(angle)])
    path = 0.05 * np.column_stack(
        [np.zeros(200), np.cos(np.linspace(0, np.pi, 200)), np.sin(np.linspace(0, np.pi, 200))]
    )
    half_torus = sweep(path, section)
    assert half_torus.volume() == pytest.approx(np.pi * 0.05 * area(section), rel=2e-3)


def test_turned_is_a_lathe_moved():
    profile = np.array([(0.02, 0.0), (0.01, 0.05)])
    solid = turned(profile, (0.1, 0.2, 0.3), (1, 0, 0), SEGMENTS)
    low, high = np.reshape(solid.bounding_box(), (2, 3))
    assert solid.volume() == pytest.approx(lathe(profile, SEGMENTS).volume(), rel=1e-9)
    assert np.allclose([low[0], high[0]], [0.1, 0.15])
    assert np.allclose((low + high)[1:] / 2, [0.2, 0.3], atol=1e-4)


def test_sections_that_shrink_to_a_cone():
    section = superellipse(2, 2, 2, 80)
    solid = upright(np.array([(0.05, 0), (1e-6, 0.09)]), section)
    assert solid.volume() == pytest.approx(area(section) * 0.05**2 * 0.09 / 3, rel=1e-3)


@given(st.floats(0.01, 0.2), st.floats(0.01, 0.2), st.floats(0, 0.3), st.floats(0.001, 0.02))
@settings(max_examples=30, deadline=None)
def test_a_plate_without_rounded_rim_is_its_outline_times_its_thickness(width, height, corner, thickness):
    corners = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * [width / 2, height / 2]
    outline = filleted(corners, max(corner * min(width, height), 1e-4), closed=True)
    assert prism(outline, thickness).volume() == pytest.approx(area(outline) * thickness, rel=1e-6)
    assert prism(outline[::-1], thickness).volume() > 0


def test_a_slab_keeps_its_size_and_loses_little_to_its_fillets():
    solid = slab((0.01, 0.07, 0.15), 0.01, 0.002, (1, 2, 3))
    low, high = np.reshape(solid.bounding_box(), (2, 3))
    assert np.allclose(high - low, [0.01, 0.07, 0.15])
    assert np.allclose((low + high) / 2, [1, 2, 3])
    sharp = 0.01 * (0.07 * 0.15 - (4 - np.pi) * 0.01**2)
    # A fillet of radius r takes (1 - pi/4) r^2 along each edge of both faces.
    perimeter = 2 * (0.07 + 0.15) - (8 - 2 * np.pi) * 0.01
    expected = sharp - 2 * (1 - np.pi / 4) * 0.002**2 * perimeter
    assert solid.volume() == pytest.approx(expected, rel=5e-3)


def test_filleted_corner_is_tangent_and_has_its_radius():
    points = np.array([(0, 0), (1, 0), (1, 1)], dtype=float)
    arc = filleted(points, 0.25)
    centre = np.array([0.75, 0.25])
    assert np.allclose(arc[[0, -1]], points[[0, -1]])
    assert np.allclose(arc[[1, -2]], [[0.75, 0], [1, 0.25]])
    assert np.allclose(np.linalg.norm(arc[1:-1] - centre, axis=1), 0.25)


def test_a_fillet_that_does_not_fit_is_made_smaller():
    square = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], dtype=float)
    rounded = filleted(square, 10.0, closed=True)
    assert rounded.min() >= 0 and rounded.max() <= 1
    assert area(rounded) == pytest.approx(1 - (4 - np.pi) * 0.49**2, rel=5e-3)


@given(st.floats(1.5, 9), st.integers(16, 80))
@settings(max_examples=30, deadline=None)
def test_superellipse_satisfies_its_equation(exponent, count):
    x, y = superellipse(3, 2, exponent, count).T
    assert np.allclose(np.abs(x / 1.5) ** exponent + np.abs(y) ** exponent, 1)


def test_flutes_cut_only_inwards():
    radius = np.linalg.norm(fluted(0.1, 12, 240), axis=1)
    assert radius.max() == pytest.approx(1) and radius.min() == pytest.approx(0.9)


def test_body_along_y_passes_its_stations_without_overshoot():
    stations = np.array([(0, -0.01, 0.01, 0.02), (0.1, -0.03, 0.01, 0.04), (0.2, -0.03, 0.02, 0.03)])
    low, high = np.reshape(along_y(stations, 2.0, 41, 80).bounding_box(), (2, 3))
    assert np.allclose([low[1], high[1]], [0, 0.2])
    assert low[2] >= -0.03 and high[2] <= 0.02 and high[0] - low[0] <= 0.04
    assert high[0] - low[0] == pytest.approx(0.04, rel=1e-2)


def test_union_and_cut_obey_inclusion_and_exclusion():
    a, b = box((1, 1, 1)), rod((0, 0, -1), (0, 0, 1), 0.3, segments=SEGMENTS)
    common = (a ^ b).volume()
    assert common == pytest.approx(POLYGON * np.pi * 0.09, rel=1e-6)
    assert union([a, b]).volume() == pytest.approx(a.volume() + b.volume() - common, rel=1e-6)
    assert cut(a, [b]).volume() == pytest.approx(1 - common, rel=1e-6)


def test_winding_is_turned_outward_and_holes_are_refused():
    ring = superellipse(1, 1, 2, 12)
    rings = np.stack([np.column_stack([ring, np.full(12, z)]) for z in (0.0, 1.0)])
    assert loft(rings).volume() > 0
    assert loft(rings[::-1]).volume() == pytest.approx(loft(rings).volume())
    with pytest.raises(ValueError, match="closed solid"):
        closed(np.eye(3), np.array([[0, 1, 2]]))
