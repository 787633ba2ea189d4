"""The elastic layer and contacts with it, against closed forms and a plain solve of the layer's equations."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal

from palpate.configuration import ConfigError
from palpate.sensor import load
from palpate.touch import RayCaster, empty_reading, face_sensor, press_sensor, press_sensors, sense, shade_pressed
from palpate.touch.gel import Face, Layer, NotConverged, contact, face, indent, press, response

PIXEL, MODULUS = 1e-4, 1e5  # m, Pa
GEL = Layer(2e-3, MODULUS, 0.48)
POISSON = (0, 0.3, 0.45, 0.49, 0.4999, 0.5)


def grid(n: int, pixel: float = PIXEL) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates y, z (n, n) of the centres of n x n pixels around 0."""
    places = (np.arange(n) + 0.5 - n / 2) * pixel
    return np.meshgrid(places, places)


def ball(n: int, radius: float, pixel: float = PIXEL) -> np.ndarray:
    """(n, n) a paraboloid of this radius, as Hertz takes a ball."""
    y, z = grid(n, pixel)
    return (y**2 + z**2) / (2 * radius)


def total(image: np.ndarray, pixel: float = PIXEL) -> np.ndarray:
    """The integral of an image (r, c, ...) over the face."""
    return image.sum(axis=(0, 1)) * pixel**2


def solved(k: float, layer: Layer) -> np.ndarray:
    """(3, 3) motion along k, across k and into the gel by tractions likewise, by solving the layer's equations.

    Displacements u = exp(ikx) f(z), w = exp(ikx) g(z) in plane strain; f and g are combinations of exp(±kz) and
    z exp(±kz). Four conditions: no motion at the base z = 0, stresses at the face z = h.
    """
    h, modulus, poisson = layer
    kolosov = 3 - 4 * poisson
    # Each column: u, w, and the tractions sigma_xz, sigma_zz at z, of one basis function (Papkovich and Neuber:
    # 2 G u = K (psi_x, psi_z) terms): u_x = i s A, u_z = B with the four solutions of Navier's equations below.

    def basis(z: float) -> np.ndarray:
        columns = []
        for sign in (1, -1):
            e, q = np.exp(sign * k * (z - h / 2)), sign * k
            # (1) irrotational and without volume change: u = grad exp(ikx + qz). Stress 2 G grad grad.
            columns.append([1j * k * e, q * e, 2 * modulus * 1j * k * q * e, 2 * modulus * q * q * e])
            # (2) z grad phi - K phi e_z with phi = exp(ikx + qz) (Papkovich and Neuber).
            u, w = 1j * k * z * e, (q * z - kolosov) * e
            du, dw = 1j * k * (1 + q * z) * e, (q + q * (q * z - kolosov)) * e
            shear = modulus * (du + 1j * k * w)
            # sigma_zz = 2 G (dw + nu / (1 - 2 nu) div u); div u = (1 - K) q e, and 1 - K = -2 (1 - 2 nu).
            upright = 2 * modulus * (dw - 2 * poisson * q * e)
            columns.append([u, w, shear, upright])
        return np.array(columns).T

    base, top = basis(0.0), basis(h)
    conditions = np.concatenate([base[:2], top[2:]])
    scale = np.abs(conditions).max(axis=0)
    motions = top[:2] @ (np.linalg.solve(conditions / scale, np.eye(4)[:, 2:]) / scale[:, None])
    into = np.diag([1, -1])  # pressure and indentation point inwards
    motions = into @ motions @ into
    across = np.tanh(k * h) / (modulus * k)  # antiplane shear: one equation
    return np.array([[motions[0, 0], 0, motions[0, 1]], [0, across, 0], [motions[1, 0], 0, motions[1, 1]]])


@pytest.mark.parametrize("poisson", POISSON)
def test_response_is_that_of_a_plain_solve(poisson):
    for k in (30.0, 500.0, 2e3, 5e3):
        layer = Layer(2e-3, MODULUS, poisson)
        found, expected = response(k, layer), solved(k, layer)
        size = np.abs(expected).max()
        assert_allclose(expected[2, 2], found.normal, rtol=1e-8, atol=1e-9 * size)
        assert_allclose(expected[0, 0], found.along, rtol=1e-8, atol=1e-9 * size)
        assert_allclose(expected[0, 2], -1j * found.spread, rtol=1e-8, atol=1e-9 * size)
        assert_allclose(expected[0, 2], np.conj(expected[2, 0]), rtol=1e-8, atol=1e-9 * size)  # reciprocity


@pytest.mark.parametrize("poisson", POISSON)
def test_response_limits(poisson):
    layer = Layer(2e-3, MODULUS, poisson)
    uniform, fine = response(0.0, layer), response(1e7, layer)
    confined = layer.thickness * (1 - 2 * poisson) / (2 * MODULUS * (1 - poisson))
    assert_allclose(uniform.normal, confined, rtol=1e-12, atol=1e-20)
    assert_allclose([uniform.along, uniform.across], layer.thickness / MODULUS, rtol=1e-12)
    assert_allclose(fine.normal, (1 - poisson) / (MODULUS * 1e7), rtol=1e-12)  # Boussinesq
    assert_allclose(fine.spread, -(1 - 2 * poisson) / (2 * MODULUS * 1e7), rtol=1e-12, atol=1e-22)
    assert all((np.isfinite(values) & (values >= 0)).all() for values in response(np.logspace(-9, 9, 99), layer)[:3])


def test_thin_incompressible_layer_is_reynolds():
    k = 1.0
    assert_allclose(response(k, Layer(1e-3, MODULUS, 0.5)).normal, k**2 * 1e-9 / (3 * MODULUS), rtol=1e-5)


THICK = (5e-3, 1e-2)  # m: of gels from which a half-space is extrapolated; what the base takes off goes as 1 / h


def test_hertz():
    """Contact radius, largest pressure, and the approach as the layer becomes a half-space."""
    radius, a, poisson = 5e-3, 1e-3, 0.4
    force = 4 / 3 * 2 * MODULUS / (1 - poisson) * a**3 / radius  # with E / (1 - nu^2)
    gels = [Layer(thickness, MODULUS, poisson) for thickness in THICK]
    pressed = [press(ball(30, radius), (PIXEL, PIXEL), gel, force, tolerance=1e-5) for gel in gels]
    # Whole pixels: of a radius of 10, 316 centres lie within it, 308 within 0.99 of it (1 % less by area), and 332
    # within 1.02 of it (2.8 % more).
    assert_allclose(np.sqrt(total(pressed[1].pressure > 0) / np.pi), a, rtol=0.02)
    assert_allclose(pressed[1].pressure.max(), 3 * force / (2 * np.pi * a**2), rtol=0.01)
    # What the base takes off goes on as 1 / h^3, of which 6 (a / h)^3 is left, 0.6 % times a number near 1; and the
    # middle of a pixel is (pixel / a)^2 / 12 of the approach, 0.1 %, off its mean.
    assert_allclose(2 * pressed[1].approach - pressed[0].approach, a**2 / radius, rtol=0.015)


def test_flat_punch():
    """Sneddon's approach F / (2 a E*), and his pressure in the middle."""
    n, force, poisson = 30, 0.1, 0.4
    surface = np.where(np.hypot(*grid(n)) <= 1.2e-3, 0.0, np.inf)
    a = np.sqrt(total(surface == 0) / np.pi)
    gels = [Layer(thickness, MODULUS, poisson) for thickness in THICK]
    pressed = [press(surface, (PIXEL, PIXEL), gel, force, tolerance=1e-5) for gel in gels]
    approach = 2 * pressed[1].approach - pressed[0].approach
    assert_allclose(approach, force * (1 - poisson) / (4 * a * MODULUS), rtol=0.02)
    assert_allclose(pressed[1].pressure[n // 2, n // 2], force / (2 * np.pi * a**2), rtol=0.03)


def test_confined_compression_is_exact():
    layer, pressure = Layer(2e-3, MODULUS, 0.3), 1e4
    gel = Face(layer, (30, 20), (PIXEL, PIXEL), padding=0)
    gel.padded = (30, 20)  # without a margin the layer is loaded everywhere
    moved = gel.moved(np.full((1, 30, 20), pressure))[2]
    assert_allclose(moved, pressure * layer.thickness * (1 - 0.6) / (2 * MODULUS * 0.7), rtol=1e-12)


def test_an_incompressible_gel_keeps_its_volume():
    """Far around the contact: what goes in comes out."""
    pressed = press(ball(120, 2e-3), (PIXEL, PIXEL), Layer(5e-4, MODULUS, 0.5), 0.05)
    assert abs(total(pressed.indentation)) < 1e-3 * total(np.maximum(pressed.indentation, 0))


def test_thin_incompressible_contact_approaches_its_limit():
    """A paraboloid on a thin layer: p = 3 G / (32 R h^3) (a^2 - r^2)^2, of w = -h^3 / (3 G) div grad p."""
    errors = []
    for thickness in (4e-4, 1e-4):
        surface, layer = ball(60, 5e-2), Layer(thickness, MODULUS, 0.5)
        force = 0.02 * (4e-4 / thickness)
        pressed = press(surface, (PIXEL, PIXEL), layer, force, tolerance=1e-5)
        # Of the force, without the radius, which pixels round: F = pi G a^6 / (32 R h^3).
        a = (force * 32 * 5e-2 * thickness**3 / (np.pi * MODULUS)) ** (1 / 6)
        errors.append(abs(pressed.pressure.max() / (3 * force / (np.pi * a**2)) - 1))
    assert errors[1] < 0.5 * errors[0] and errors[1] < 0.08


SURFACES = {
    "ball": ball(40, 2e-3),
    "flat": np.zeros((40, 40)),
    "wedge": np.abs(grid(40)[0]),
    "tilt": 0.3 * grid(40)[1],
    "hole": np.where(ball(40, 1) > 5e-7, 0.0, np.inf),
    "rough": np.random.default_rng(0).normal(0, 3e-5, (40, 40)),
    "one pixel": np.where(np.arange(1600).reshape(40, 40) == 820, 0.0, np.inf),
    "corner pixel": np.where(np.arange(1600).reshape(40, 40) == 0, 0.0, np.inf),
}


@pytest.mark.parametrize("name", SURFACES)
@pytest.mark.parametrize("poisson", (0.3, 0.5))
def test_contact_conditions(name, poisson):
    """Pressures push, nothing penetrates, no pressure without contact, and the pressures sum to the force."""
    surface = SURFACES[name]
    for force in (1e-3, 1.0, 20.0):
        pressed = press(surface, (PIXEL, PIXEL), GEL._replace(poisson=poisson), force)
        gap = pressed.indentation + surface - surface.min() - pressed.approach
        assert abs(total(pressed.pressure) / force - 1) < 1e-12
        assert pressed.pressure.min() == 0 or name in ("flat", "rough", "tilt", "wedge", "ball")
        scale = 1e-3 * np.abs(pressed.indentation).max()
        assert (pressed.pressure >= 0).all() and gap[np.isfinite(gap)].min() >= -scale
        assert (pressed.pressure[np.isinf(surface)] == 0).all()
        touching = pressed.pressure > 0
        assert (pressed.pressure[touching] * np.abs(gap[touching])).sum() <= scale * pressed.pressure.sum()


def test_only_the_shape_counts():
    pressed, moved = (press(surface, (PIXEL, PIXEL), GEL, 0.5) for surface in (ball(40, 2e-3), ball(40, 2e-3) + 0.02))
    assert_allclose(moved.pressure, pressed.pressure, rtol=1e-9)
    assert_allclose(moved.approach, pressed.approach, rtol=1e-9)


def test_mirror_symmetry():
    """A mirrored surface gives mirrored images; the sideways motion changes sign across the mirror."""
    y, z = grid(40)
    surface = (y - 3e-4) ** 2 / 4e-3 + (z + 5e-4) ** 2 / 8e-3
    one, other = (press(each, (PIXEL, PIXEL), GEL, 0.5, slide=(0, 1e-5)) for each in (surface, surface[:, ::-1]))
    assert_allclose(other.pressure, one.pressure[:, ::-1], atol=1e-6 * one.pressure.max())
    mirrored = one.displacement[:, ::-1] * [-1, 1]
    assert_allclose(other.displacement, mirrored, atol=1e-6 * np.abs(mirrored).max())
    turned = press(surface.T, (PIXEL, PIXEL), GEL, 0.5, slide=(1e-5, 0))
    assert_allclose(
        turned.displacement, one.displacement.transpose(1, 0, 2)[..., ::-1], atol=1e-6 * np.abs(mirrored).max()
    )


def test_reciprocity():
    """Work of one load on the motion by another, both ways; pressures and sideways tractions (Betti)."""
    rng, gel = np.random.default_rng(0), Face(GEL, (24, 33), (PIXEL, 1.3 * PIXEL))
    p, q = rng.random((2, 24, 33))
    s, t = rng.normal(size=(2, 2, 24, 33))
    assert_allclose((p * gel.moved(q[None])[2]).sum(), (q * gel.moved(p[None])[2]).sum(), rtol=1e-12)
    assert_allclose((s * gel.moved(t, (0, 1), (0, 1))).sum(), (t * gel.moved(s, (0, 1), (0, 1))).sum(), rtol=1e-11)


@pytest.mark.parametrize("shape", [(1, 1), (5, 9), (24, 4), (24, 33)])
def test_a_block_moves_as_the_whole_face_does(shape):
    """To rounding, also where twice its size exceeds the padded face."""
    gel, pressure = Face(GEL, (24, 33), (PIXEL, 1.3 * PIXEL)), np.zeros((24, 33))
    block = tuple(slice(n - m, n) for n, m in zip((24, 33), shape, strict=True))
    pressure[block] = np.random.default_rng(0).random(shape)
    few, all_of_it = gel.moved(pressure[None][:, *block]), gel.moved(pressure[None])[:, *block]
    assert_allclose(few, all_of_it, atol=1e-12 * all_of_it.max())


def test_a_block_grows_to_all_that_touches():
    """Of two balls, the smaller one's tip a little behind the other's: it touches since the first one goes in."""
    y, z = grid(60)
    near, far = ((y - at) ** 2 + z**2 for at in (-2e-3, 2e-3))
    surface = np.minimum(near / 4e-3, far / 4e-3 + 1.5e-4)
    gel = face(GEL, surface.shape, (PIXEL, PIXEL))
    for force in (0.01, 0.1, 0.3, 1.0):
        pressure, (*_, moved), approach = indent(gel, surface, force, tolerance=1e-5)
        gap = moved + surface - approach
        assert gap.min() >= -1e-5 * moved.max() and abs(total(pressure) / force - 1) < 1e-12
        again, _, depth = indent(gel, surface, depth=approach, tolerance=1e-5)
        assert_allclose(again, pressure, atol=1e-3 * pressure.max())
        assert depth == approach


def test_response_to_one_pixel_is_a_sum_over_wavenumbers():
    """A naive sum over the same wavenumbers of a periodic layer; and over many more, for what aliases leave out."""
    n, layer, pressure = 16, Layer(3e-4, MODULUS, 0.45), np.zeros((16, 16))
    pressure[3, 5] = 1
    gel = Face(layer, (n, n), (PIXEL, PIXEL), padding=0)
    gel.padded = (n, n)
    spread, _, moved = gel.moved(pressure[None])
    for reach, tolerance in ((2.5, 1e-10), (20, 0.01)):
        orders = np.arange(-reach * n, reach * n + 1)
        k, weight = orders * 2 * np.pi / (n * PIXEL), np.sinc(orders / n) ** 2
        if reach == 2.5:  # the grid's largest wavenumber stands for both of its signs
            weight[[0, -1]] /= 2
        weight, size = weight[:, None] * weight, np.hypot(k[:, None], k)
        of_wave = response(size, layer)
        sideways = of_wave.spread * k / np.maximum(size, 1)
        for row, column in ((3, 5), (4, 5), (9, 14)):
            wave = weight * np.exp(1j * PIXEL * (k[:, None] * (row - 3) + k * (column - 5))) / n**2
            assert_allclose(moved[row, column], (of_wave.normal * wave).sum().real, atol=tolerance * moved.max())
            expected = (-1j * sideways * wave).sum().real
            assert_allclose(spread[row, column], expected, atol=tolerance * np.abs(spread).max())


RADIUS, CONTACT, FRICTION, COMPRESSIBLE = 5e-3, 1e-3, 0.5, 0.4  # m, m; of Hertz's contact on a thick gel
HERTZ_FORCE = 4 / 3 * 2 * MODULUS / (1 - COMPRESSIBLE) * CONTACT**3 / RADIUS


@pytest.mark.parametrize("stick", (0.4, 0.7))
def test_partial_slip_is_cattaneos_and_mindlins(stick):
    """Sliding force, and radius of the disc that sticks; its share `stick` of the contact gives the slide."""
    slide = 3 * FRICTION * HERTZ_FORCE * (2 - COMPRESSIBLE) / (16 * MODULUS * CONTACT) * (1 - stick**2)
    layer = Layer(THICK[1], MODULUS, COMPRESSIBLE)
    pressed = press(ball(30, RADIUS), (PIXEL, PIXEL), layer, HERTZ_FORCE, (slide, 0), friction=FRICTION)
    forces = total(pressed.traction)
    assert_allclose(forces[0], FRICTION * HERTZ_FORCE * (1 - stick**3), rtol=0.03)
    assert abs(forces[1]) < 1e-6 * forces[0]
    slips = np.linalg.norm(pressed.traction, axis=-1) >= FRICTION * pressed.pressure * (1 - 1e-9)
    # Whole pixels, by eights of mirror images: of the smaller disc, 4 pixels in radius, eight are 8 % by area.
    assert_allclose(np.sqrt(total(~slips) / np.pi), stick * CONTACT, rtol=0.08)


def test_a_twist_sticks_as_reissner_and_sagoci_and_slips_as_coulomb():
    y, z = grid(30)
    layer, torques = Layer(THICK[0], MODULUS, COMPRESSIBLE), []
    for twist in (1e-3, 0.5):
        pressed = press(ball(30, RADIUS), (PIXEL, PIXEL), layer, HERTZ_FORCE, twist=twist, friction=FRICTION)
        torques.append(total(y * pressed.traction[..., 1] - z * pressed.traction[..., 0]))
    assert_allclose(torques[0], 16 / 3 * MODULUS * CONTACT**3 * 1e-3, rtol=0.05)
    assert_allclose(torques[1], 3 * np.pi / 16 * FRICTION * HERTZ_FORCE * CONTACT, rtol=0.02)


def test_friction_obeys_coulomb_and_sticks_where_it_does_not_slip():
    """On a thin layer, where tractions and pressures do not have one response: the conditions themselves."""
    surface, slide = ball(60, 4e-3), (1.5e-5, -1e-5)
    pressed = press(surface, (PIXEL, PIXEL), GEL, 0.5, slide, friction=0.6, tolerance=1e-4)
    size, limit = np.linalg.norm(pressed.traction, axis=-1), 0.6 * pressed.pressure
    assert (size <= limit * (1 + 1e-9) + 1e-9).all()
    moved = face(GEL, surface.shape, (PIXEL, PIXEL)).moved(np.moveaxis(pressed.traction, -1, 0), (0, 1), (0, 1))
    moved = np.moveaxis(moved, 0, -1) @ slide / np.linalg.norm(slide)
    sticks = size < limit * (1 - 1e-6)
    assert sticks.any() and (limit[~sticks] > 0).any()
    assert_allclose(moved[sticks], np.linalg.norm(slide), rtol=0.02)
    assert (moved[~sticks & (limit > 0)] <= np.linalg.norm(slide) * 1.02).all()
    at_rest = press(surface, (PIXEL, PIXEL), GEL, 0.5)
    assert not at_rest.traction.any()
    assert_array_equal(press(surface, (PIXEL, PIXEL), GEL, 0.5, slide, friction=0).traction, 0)


def test_single_precision_has_its_digits():
    double, single = (
        press(ball(40, 2e-3), (PIXEL, PIXEL), GEL, 0.5, dtype=dtype) for dtype in (np.float64, np.float32)
    )
    assert single.indentation.dtype == single.displacement.dtype == np.float32
    assert_allclose(single.indentation, double.indentation, atol=1e-3 * double.indentation.max())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"surface": np.full((4, 4), np.inf)}, "somewhere finite"),
        ({"surface": np.full((4, 4), np.nan)}, "got none, NaN"),
        ({"force": 0.0}, "a force of 0.0 N"),
        ({"force": np.inf}, "a force of inf N"),
        ({"layer": Layer(2e-3, MODULUS, 0.51)}, "Poisson's ratio of 0 to 0.5"),
        ({"layer": Layer(0.0, MODULUS, 0.5)}, "thickness"),
    ],
)
def test_refuses_what_it_cannot_press(change, message):
    arguments = {"surface": np.zeros((4, 4)), "pixel": (PIXEL, PIXEL), "layer": GEL, "force": 1.0} | change
    with pytest.raises(ValueError, match=message):
        press(**arguments)


def test_says_if_it_does_not_converge():
    with pytest.raises(NotConverged, match="did not settle"):
        contact(lambda p: p, np.linspace(0, 1, 16).reshape(4, 4), np.full((4, 4), 1 / 16), 1.0, tolerance=-1.0)


@pytest.fixture(scope="module")
def mini():
    """A GelSight Mini of fewer pixels, with dots."""
    sensor = load("gelsight_mini")
    return replace(sensor, resolution=(60, 80), markers={"rows": 3, "columns": 4})


def ball_before(sensor, y: float = 0.0, z: float = 0.0) -> RayCaster:
    """A ball of 5 mm, 1 mm before the gel's face."""
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=0.005)
    mesh.apply_translation((sensor.gel_face + 0.006, y, z))
    return RayCaster(mesh, sensor=face_sensor(sensor))


def test_a_pressed_sensor(mini):
    """Force, window and dots of a ball in the middle, and one of no force."""
    poses = np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1))
    pressed = press_sensors(ball_before(mini), mini, *poses, np.array([0.5, 0.0]))
    assert_array_equal(pressed["force"], [0.5, 0])
    assert_array_equal(pressed["inside"], [1, 0])
    assert_allclose(pressed["pressure"].sum(axis=(1, 2)) * np.prod(mini.pixel), [0.5, 0], rtol=1e-6)
    empty = shade_pressed(np.zeros(mini.resolution), mini)
    assert_array_equal(pressed["reading"][1], empty)
    assert (pressed["reading"][0] != empty).any()
    row, column = pressed["markers"][1].transpose(2, 0, 1)
    assert_allclose(row[:, 0], [9.5, 29.5, 49.5])
    assert_allclose(column[0], [9.5, 29.5, 49.5, 69.5])
    # A gel that keeps its volume moves away from the ball.
    away = (pressed["markers"][0] - pressed["markers"][1]) * (pressed["markers"][1] - [29.5, 39.5])
    assert away.sum(axis=-1).min() >= 0 and away.max() > 0.01
    assert pressed["displacement"][0, 30, 45, 0] > 0 > pressed["displacement"][0, 30, 34, 0]
    assert pressed["displacement"][0, 35, 40, 1] > 0 > pressed["displacement"][0, 24, 40, 1]


def test_force_beside_the_image_counts_for_the_gel(mini):
    """A ball whose middle is on the edge of the image has half of the force inside."""
    caster = ball_before(mini, y=mini.width / 2)
    pressed = press_sensors(caster, mini, np.zeros(3), np.eye(3), np.float64(0.5))
    assert 0.4 < pressed["inside"] < 0.6
    assert_allclose(pressed["pressure"].sum() * np.prod(mini.pixel), pressed["inside"] * 0.5, rtol=1e-6)


def test_a_convex_face_touches_first_in_its_middle():
    """A plane against the DIGIT's face: contact in the middle, symmetric; against a flat one nearly everywhere."""
    digit = load("digit")
    wide = face_sensor(digit)
    assert face_sensor(digit) is wide  # whose arrays are computed once for all presses
    assert wide.resolution == (146, 122) and wide.pixel == pytest.approx(digit.pixel)
    plane = np.full(wide.resolution, digit.gel_face)
    convex, flat = (press_sensor(plane, replace(digit, gel_sag=sag), 2.0) for sag in (digit.gel_sag, 0.0))
    touched = convex["pressure"] > 0
    assert touched[50, 50] and not touched[0, 0] and convex["inside"] == 1
    assert_allclose(convex["pressure"], convex["pressure"][::-1, ::-1], atol=0.01 * convex["pressure"].max())
    assert (flat["pressure"] > 0).all() and flat["inside"] < 0.9
    # The face's own curvature is in the untouched image.
    untouched = shade_pressed(np.zeros(digit.resolution), digit)
    assert (untouched != empty_reading(digit)).any()
    assert_array_equal(shade_pressed(np.zeros(digit.resolution), replace(digit, gel_sag=0.0)), empty_reading(digit))


def test_a_gel_without_a_material_is_not_pressed():
    for sensor in (load("dome360"), replace(load("digit"), material=None)):
        with pytest.raises(ConfigError, match="can't be pressed: its file needs gel.thickness"):
            press_sensor(np.zeros(sensor.resolution), sensor, 1.0)


@pytest.mark.parametrize("name", ("digit", "gelsight_mini"))
def test_readings_that_are_not_pressed_do_not_depend_on_the_gel(name):
    """Bit for bit: what a sensor's file says of its gel counts for pressed readings only."""
    sensor = load(name)
    bare = replace(sensor, material=None, gel_size=None, gel_sag=0.0)
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.01)
    mesh.apply_translation((0.031, 0.001, 0.002))
    one, other = (sense(RayCaster(mesh, sensor=kind), np.zeros((1, 3)), np.eye(3)[None]) for kind in (sensor, bare))
    assert one.success.all()
    for array, expected in zip(one, other, strict=True):
        assert array.tobytes() == expected.tobytes()
    assert sensor.geometry == bare.geometry  # what grasps are made of
