"""The finite elements of a gel against closed forms, at small and at finite strain."""

import numpy as np
from numpy.testing import assert_allclose

from studies.finite_elements import Gel, ball

MODULUS = 1e5


def everywhere(r):
    """A plate wider than the gel."""
    return np.zeros_like(r), np.zeros_like(r)


def test_uniaxial_compression_of_a_gel_that_is_held_at_its_side():
    """Confined: the force of the energy's own closed form, at 20 % of strain."""
    gel = Gel(2e-3, MODULUS, 0.3, fine=2e-3, columns=6, rows=4, width=2.0)
    gel.free.reshape(-1, 2)[gel.nodes[:, 0] == gel.nodes[:, 0].max(), 0] = False
    pressed = gel.press(everywhere, 4e-4)
    stretch = 1 - pressed.indentation.mean() / 2e-3
    stress = MODULUS * (stretch - 1 / stretch) + gel.lame * np.log(stretch) / stretch
    assert_allclose(pressed.indentation, 4e-4, rtol=0.01)
    assert_allclose(pressed.force, -stress * np.pi * 4e-3**2, rtol=1e-3)


def test_hertz_on_a_thick_gel():
    """Force and contact at a thousandth of the thickness, where strain is small."""
    gel, radius, depth = Gel(0.02, MODULUS, 0.4, fine=1e-3, columns=24, rows=14, width=2.0), 0.01, 2e-5
    pressed = gel.press(ball(radius), depth)
    stiffness = 2 * MODULUS / (1 - 0.4)
    assert_allclose(pressed.force, 4 / 3 * stiffness * np.sqrt(radius) * depth**1.5, rtol=0.03)
    assert abs(pressed.indentation[-1]) < 0.02 * depth and pressed.indentation[0] <= depth * 1.01


def test_a_body_is_hardly_in_the_gel():
    """Also at 0.4 of the thickness, where the pressure is a few shear moduli."""
    gel, profile = Gel(0.004, 145e3, 0.48, fine=0.003, columns=32, rows=8), ball(0.003)
    pressed = gel.press(profile, 1.6e-3)
    inside = pressed.indentation - (1.6e-3 - profile(pressed.radius + pressed.sideways)[0])
    touching = pressed.radius + pressed.sideways < 2e-3
    assert_allclose(inside[touching], 0, atol=2e-6)
