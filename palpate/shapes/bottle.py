"""Bottles: lathed bodies with shoulder, neck and cap; handles, ribs and labels on some."""

import numpy as np

from palpate.shapes.scene import Material, Part
from palpate.shapes.solids import filleted, lathe

GLASS = {
    "green-glass": (28, 74, 40),
    "olive-glass": (74, 82, 30),
    "amber-glass": (112, 56, 16),
    "clear-glass": (196, 216, 214),
    "blue-glass": (26, 60, 130),
}
CAPS = {
    "red-cap": (170, 24, 28),
    "white-cap": (235, 235, 230),
    "gold-cap": (190, 150, 60),
    "black-cap": (25, 25, 28),
}


def pick(rng, colours: dict, metallic=0.0, roughness=0.3) -> Material:
    name = list(colours)[rng.integers(len(colours))]
    return Material(name, colours[name], metallic, roughness)


def wine(rng) -> list[Part]:
    """A wine bottle: straight body, shoulder, long neck with a finish ring and a capsule."""
    radius, height = rng.uniform(0.034, 0.045), rng.uniform(0.28, 0.34)
    neck, shoulder = rng.uniform(0.0135, 0.016), rng.uniform(0.5, 0.66) * height
    slope = rng.uniform(0.03, 0.12)
    profile = [
        (0, 0.008), (radius * 0.6, 0.004), (radius * 0.85, 0), (radius, 0.006), (radius, shoulder),
        (neck + 0.001, shoulder + slope), (neck, height - 0.02), (neck + 0.002, height - 0.02),
        (neck + 0.002, height - 0.012), (neck, height - 0.012), (neck, height),
    ]  # fmt: skip
    radii = [0, 0.01, 0.003, 0.006, 0.04, 0.06, 0, 0.001, 0.001, 0, 0.001]
    cap = [(neck + 0.0006, height - 0.05), (neck + 0.0028, height - 0.022), (neck + 0.0028, height + 0.001)]
    return [
        Part(lathe(filleted(np.array(profile), radii), 64), pick(rng, GLASS, 0, 0.1)),
        Part(lathe(filleted(np.array(cap), 0.001), 64), pick(rng, CAPS)),
    ]


STYLES = [wine]
