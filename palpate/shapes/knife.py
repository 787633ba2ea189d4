"""Knives: a lofted blade with bevel and edge, a bolster, and a handle of scales with rivets."""

import numpy as np

from palpate.shapes.scene import Material, Part
from palpate.shapes.solids import box, loft, superellipse

STEEL = Material("steel", (190, 192, 196), 0.9, 0.28)
HANDLES = {"black-handle": (30, 30, 32), "walnut handle": (92, 56, 32), "red handle": (150, 30, 30)}


def blade(y, spine, edge, thickness, edge_thickness=0.0003):
    """A blade along y: spine and edge heights z (k,), thickness at the spine (k,)."""
    bevel = edge + 0.55 * (spine - edge)
    thickness = np.broadcast_to(thickness, y.shape)
    tip = np.minimum(thickness, edge_thickness)
    columns = [
        (thickness / 2, spine), (-thickness / 2, spine), (-thickness / 2, bevel),
        (-tip / 2, edge), (tip / 2, edge), (thickness / 2, bevel),
    ]  # fmt: skip
    return loft(np.stack([np.stack([x, y, z], -1) for x, z in columns], axis=1))


def chef(rng) -> list[Part]:
    """A kitchen knife."""
    length, height = rng.uniform(0.14, 0.24), rng.uniform(0.035, 0.055)
    t = np.linspace(0, 1, 50)
    curve = rng.uniform(2, 4)
    spine = height * (1 - 0.55 * t ** rng.uniform(3, 6))
    edge = (height * 0.44) * t**curve
    solid = blade(length * t, spine, np.minimum(edge, spine - 0.0008), 0.0028 - 0.0018 * t)
    grip = rng.uniform(0.105, 0.13)
    s = np.linspace(0, 1, 30)
    tall = 0.026 + 0.006 * np.cos(2 * np.pi * s)
    rings = np.array(
        [
            np.column_stack([c[:, 0], np.full(40, -grip * u), c[:, 1] + height - 0.018])
            for u, h in zip(s, tall, strict=True)
            for c in [superellipse(0.018, h, 3)]
        ]
    )
    name = list(HANDLES)[rng.integers(len(HANDLES))]
    bolster = box((0.012, 0.012, 0.026), (0, 0, height - 0.018))
    return [Part(solid + bolster, STEEL), Part(loft(rings), Material(name, HANDLES[name]))]


STYLES = [chef]
