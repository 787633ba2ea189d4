"""Cellphones: slabs, keypads, flips."""

from palpate.shapes.scene import Material, Part
from palpate.shapes.solids import slab

BODIES = {"graphite": (50, 50, 54), "silver": (190, 192, 196), "gold": (205, 180, 140), "blue": (40, 70, 120)}


def smart(rng) -> list[Part]:
    """A slab with a glass screen and a camera bump."""
    width, height, thick = rng.uniform(0.064, 0.079), rng.uniform(0.138, 0.166), rng.uniform(0.0068, 0.0095)
    corner = rng.uniform(0.006, 0.012)
    name = list(BODIES)[rng.integers(len(BODIES))]
    body = slab((thick, width, height), corner, rng.uniform(0.0012, thick / 2.1))
    screen = slab((0.002, width - 0.005, height - 0.005), corner - 0.0025, 0.0002, (thick / 2 - 0.0008, 0, 0))
    bump = slab(
        (0.003, 0.026, 0.03), 0.006, 0.0006, (-thick / 2 - 0.0005, width / 2 - 0.018, height / 2 - 0.02)
    )
    return [
        Part(body + bump, Material(name, BODIES[name], 0.7, 0.35)),
        Part(screen, Material("screen", (12, 12, 16), 0, 0.1)),
    ]


STYLES = [smart]
