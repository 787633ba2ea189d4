"""Rifles: stock, receiver, barrel, magazine, scope."""

import numpy as np

from palpate.shapes.scene import Material, Part
from palpate.shapes.solids import box, loft, rod, superellipse

GUNMETAL = Material("gunmetal", (52, 54, 58), 0.8, 0.4)
STOCKS = {"walnut": (94, 54, 30), "black-polymer": (30, 30, 32), "olive polymer": (70, 74, 48)}


def bolt_action(rng) -> list[Part]:
    """A hunting rifle."""
    barrel = rng.uniform(0.5, 0.65)
    y = np.array([-0.42, -0.40, -0.2, -0.13, -0.06, 0.0, 0.2, 0.32, 0.35])
    top = np.array([-0.012, -0.01, -0.006, -0.012, -0.004, 0.0, 0.0, -0.002, -0.008])
    bottom = np.array([-0.14, -0.142, -0.075, -0.062, -0.05, -0.048, -0.042, -0.032, -0.02])
    width = np.array([0.034, 0.042, 0.042, 0.038, 0.046, 0.05, 0.044, 0.034, 0.02])
    s = np.linspace(y[0], y[-1], 80)
    rings = []
    for position in s:
        z0, z1, w = (np.interp(position, y, v) for v in (bottom, top, width))
        c = superellipse(w, z1 - z0, 2.6)
        rings.append(np.column_stack([c[:, 0], np.full(len(c), position), c[:, 1] + (z0 + z1) / 2]))
    name = list(STOCKS)[rng.integers(len(STOCKS))]
    metal = rod((0, -0.1, 0.006), (0, 0.12, 0.006), 0.016)
    metal += rod((0, 0.1, 0.006), (0, 0.1 + barrel, 0.006), 0.013, 0.008)
    metal += rod((0, -0.14, 0.055), (0, 0.16, 0.055), 0.0135) + rod((0, 0.1, 0.055), (0, 0.18, 0.055), 0.022)
    metal += box((0.012, 0.012, 0.05), (0, -0.06, 0.03)) + box((0.012, 0.012, 0.05), (0, 0.06, 0.03))
    metal += box((0.02, 0.07, 0.03), (0, 0.0, -0.06))
    return [Part(metal, GUNMETAL), Part(loft(np.array(rings)), Material(name, STOCKS[name], 0, 0.5))]


STYLES = [bolt_action]
