"""The study of shading: its true normals and readings found in other ways, and the order of each method."""

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from palpate.touch import PIXEL_CENTRES, SENSOR_RANGE, impression, shade
from palpate.touch.shading import lit
from palpate.touch.sphere_tracing import TOLERANCE
from studies.error_vs_runtime import shading
from studies.error_vs_runtime.shading import press, study

MADE = study(None, [], {})
CASES = dict(MADE.cases())
METHODS = {str(method): method for method in MADE.methods()}
EXACT = [name for name in CASES if "traced" not in name]


@pytest.mark.parametrize("name", EXACT)
def test_true_normals_are_those_of_the_surface(name):
    """Sixth-order differences of the depth map itself, at pixels away from edges and not too steep."""
    case = CASES[name]
    height = np.maximum(SENSOR_RANGE - case.depth.astype(float), 0)
    width = PIXEL_CENTRES[1] - PIXEL_CENTRES[0]
    for axis, component in ((-1, 0), (-2, 1)):
        steps = sum(
            weight * (np.roll(height, -k, axis) - np.roll(height, k, axis))
            for k, weight in ((1, 3 / 4), (2, -3 / 20), (3, 1 / 60))
        )
        looked_at = case.inside & (case.normal[..., 2] > 0.8)
        looked_at[:, [0, 1, 2, -3, -2, -1]] = looked_at[..., [0, 1, 2, -3, -2, -1]] = False
        slope = -case.normal[..., component] / case.normal[..., 2]
        assert looked_at.sum() > 10_000
        np.testing.assert_allclose((steps / width)[looked_at], slope[looked_at], atol=2e-3)


@pytest.mark.parametrize("name", EXACT)
def test_true_readings_are_those_of_the_library_with_true_normals(name):
    case = CASES[name]
    reading = lit(impression(case.depth), case.normal.astype(np.float32))
    assert np.abs(reading - case.reading).max() < 0.51


def test_a_true_reading_by_hand():
    """The tilted pixel of tests/touch/test_reading.py: D' = 0.006 + 0.5 y at row 50, column 60."""
    height = 0.006 + 0.5 * np.broadcast_to(PIXEL_CENTRES, (1, 100, 100))
    normal = np.broadcast_to(np.array([-0.5, 0, 1]) / np.sqrt(1.25), (1, 100, 100, 3))
    towards = np.array([0 - 0.00172305, -np.sqrt(2) * 0.025 - 0.00008205, 0.025 - 0.00686153])
    expected = 255 * max(0, normal[0, 0, 0] @ towards / np.linalg.norm(towards))
    assert shading._true_reading(height, normal)[0, 50, 60, 0] == pytest.approx(expected, abs=1e-3)


def test_every_shape_is_touched_and_the_steep_ones_have_edges():
    for name, case in CASES.items():
        touched = np.isfinite(case.depth)
        assert touched.any(axis=(1, 2)).all() and case.depth.dtype == np.float32, name
        assert (case.depth[touched] >= 0).all() and (case.depth[touched] <= SENSOR_RANGE).all(), name
        assert case.inside.any() and not case.inside.all(), name


def test_sphere_tracing_stops_short_by_no_more_than_its_tolerance():
    traced = CASES["sphere 10 mm, sphere-traced"]
    exact = press(lambda random: shading._traced_sphere(0.01, random)._replace(shortfall=0), np.random.default_rng(5))
    short = press(lambda random: shading._traced_sphere(0.01, random), np.random.default_rng(5))
    both = np.isfinite(exact.depth) & np.isfinite(short.depth)
    gap = exact.depth[both].astype(float) - short.depth[both]
    assert gap.max() > 0.5 * TOLERANCE and gap.min() > -1e-8
    assert (gap * short.normal[both][:, 2] <= 1.01 * TOLERANCE + 1e-8).all()
    assert np.isfinite(traced.depth).any()


@pytest.mark.parametrize("name", EXACT)
def test_what_is_chosen_is_the_library_s_reading(name):
    chosen = [method for method in MADE.methods() if method.chosen]
    assert {method.knob for method in chosen} == {"order", "order at the border", "precision"}
    for method in chosen:
        np.testing.assert_array_equal(method.run(CASES[name])[1], shade(CASES[name].depth))


@pytest.mark.parametrize(
    ("slopes", "degree"),
    [
        (shading._one_sided, 1),
        (shading._minmod, 1),
        (shading._gradient, 2),
        (shading._sobel, 2),
        (lambda *of: shading._parabola(5, *of), 2),
        (lambda *of: shading._spline(3, *of), 4),
        (lambda *of: shading._central(4, *of), 4),
        (lambda *of: shading._spline(5, *of), 6),
        (lambda *of: shading._central(6, *of), 6),
    ],
)
def test_differences_are_exact_to_their_order_and_no_further(slopes, degree):
    """On polynomials along one axis, in pixels in the middle. (A spline is of higher order at its knots.)"""
    x, middle = (np.arange(100) - 49.5) / 5, slice(45, 55)
    per_metre = 1 / (5 * (PIXEL_CENTRES[1] - PIXEL_CENTRES[0]))
    for power in (degree, degree + 1):
        polynomial = Polynomial.basis(power)
        height = np.broadcast_to(polynomial(x), (1, 100, 100))
        true = polynomial.deriv()(x) * per_metre
        for axis, surface in ((-1, height), (-2, height.swapaxes(-1, -2))):
            found = slopes(surface, axis) if axis == -1 else slopes(surface, axis).swapaxes(-1, -2)
            off = np.abs(found - true)[0, middle, middle].max() / np.abs(true[middle]).max()
            assert (off < 1e-6) == (power == degree), (power, off)


def test_limited_differences_are_central_on_smooth_surfaces_and_do_not_cross_a_step():
    width = PIXEL_CENTRES[1] - PIXEL_CENTRES[0]
    ball = np.broadcast_to(np.sqrt(0.02**2 - PIXEL_CENTRES**2), (1, 100, 100))
    limited, central = shading._van_leer(ball, -1), shading._gradient(ball, -1)
    bend = width / 0.02  # how much the slope changes in a pixel where it is least
    off = np.abs(limited - central)[..., 1:-1]
    assert off.max() < bend
    assert off[np.abs(central[..., 1:-1]) > 2 * bend].max() < 1e-12
    step = np.broadcast_to(np.where(PIXEL_CENTRES > 0, 0.003, 0.001), (1, 100, 100))
    assert not shading._van_leer(step, -1).any() and not shading._van_leer(step, -2).any()


def test_errors_of_known_answers():
    case = CASES["sphere 10 mm"]
    rounded = np.rint(case.reading)
    right = MADE.errors(case, (case.normal, rounded))
    assert right["worst"] <= 0.5 and right["mean"] == pytest.approx(0.25, abs=0.05)
    assert right["normal"] == pytest.approx(0, abs=1e-6)
    # Turned by a degree, and three levels too bright where nothing is at an edge.
    angle = np.radians(1)
    turn = np.array([[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]])
    flat = np.zeros_like(case.normal) + [0, 0, 1.0]
    wrong = MADE.errors(case._replace(normal=flat), (flat @ turn.T, case.reading + 3 * case.inside[..., None]))
    assert wrong["normal"] == pytest.approx(1) and wrong["worst"] == pytest.approx(3)
    assert wrong["worst away from edges"] == pytest.approx(3)
    assert wrong["mean"] == pytest.approx(3 * case.inside.mean())


def test_height_that_slopes_add_up_to():
    """Normals of a slope in metres over a plane of the same slope lose nothing; flat ones all of it."""
    height = 0.004 + 0.3 * PIXEL_CENTRES
    plane = shading.Press(np.broadcast_to(SENSOR_RANGE - height, (1, 100, 100)), *(np.zeros(0) for _ in range(3)))
    tilted = np.broadcast_to(np.array([-0.3, 0, 1]) / np.sqrt(1.09), (1, 100, 100, 3))
    assert shading._height_error(plane, tilted) == pytest.approx(0, abs=1e-12)
    flat = np.broadcast_to([0.0, 0, 1], (1, 100, 100, 3))
    assert shading._height_error(plane, flat) == pytest.approx((height - height[0]).mean())


def test_central_differences_keep_a_step_and_limited_ones_lose_it():
    lost = {name: MADE.errors(CASES["step"], METHODS[name].run(CASES["step"])) for name in METHODS}
    central, limited = (lost[f"{name} differences, order 2"] for name in ("central", "limited"))
    assert limited["mean"] < central["mean"] / 2
    assert limited["height"] > 10 * central["height"]
