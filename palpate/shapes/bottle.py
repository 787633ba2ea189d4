"""Bottles: lathed or lofted bodies with shoulder and neck, caps, handles, pumps, ribs and labels.

Metres; the bottle stands on z = 0 around the z axis.
"""

import numpy as np
from manifold3d import CrossSection, Manifold

from palpate.shapes.assembly import Part
from palpate.shapes.materials import (
    PLASTIC,
    Material,
    across,
    around,
    choose,
    glass,
    label,
    metal,
    plastic,
    wood,
)
from palpate.shapes.solids import (
    box,
    cut,
    filleted,
    fluted,
    lathe,
    rod,
    rounded_rectangle,
    superellipse,
    sweep,
    turned,
    union,
    upright,
)

AROUND = 72
# A label stands off the body by this much.
PAPER = 0.0005


def wrapped_label(rng, radius: float, low: float, high: float, span: float | None = None) -> Part:
    """A label on a straight round body, centred on +x, over `span` degrees."""
    span = rng.uniform(150, 330) if span is None else span
    section = [(radius - 0.002, low), (radius + PAPER, low), (radius + PAPER, high), (radius - 0.002, high)]
    shell = Manifold.revolve(CrossSection([np.array(section)]), AROUND, span).rotate((0, 0, -span / 2))
    return Part(shell, label(rng), around)


def flat_label(rng, body: Manifold, width: float, low: float, high: float) -> Part:
    """A label on the +x side of any body: the body's skin within a rectangle, raised."""
    (x0, y0, z0, x1, y1, z1) = body.bounding_box()
    grow = [1 + 2 * PAPER / (x1 - x0), 1 + 2 * PAPER / (y1 - y0), 1]
    window = box((x1, width, high - low), (x1 / 2 + 0.3 * x1, 0, (low + high) / 2))
    return Part((body.scale(grow) ^ window) - body.scale((1 - 4 * PAPER / (x1 - x0), 1, 1)), label(rng), across)


def screw_cap(radius: float, low: float, height: float, ribs: int) -> Manifold:
    """A knurled cap with a rounded top."""
    profile = filleted(np.array([(radius, low), (radius, low + height), (0, low + height)]), [0, 0.15 * height, 0])
    profile = profile[profile[:, 0] > 1e-4]
    return upright(profile, fluted(0.05, ribs, 4 * ribs))


def crown_cap(radius: float, top: float) -> Manifold:
    """A crown cap: 21 teeth around the rim."""
    profile = np.array([(1.22, -0.005), (1.12, -0.002), (1.0, 0.001), (0.85, 0.002)])
    teeth = np.stack([fluted(depth, 21, 84) for depth in (0.1, 0.05, 0, 0)])
    return upright(profile * [radius, 1] + [0, top], teeth)


def cork(neck: float, top: float) -> Manifold:
    """A cork that stands out of the mouth."""
    return lathe(
        filleted(np.array([(neck * 0.7, top - 0.02), (neck * 0.82, top + 0.014), (0, top + 0.014)]), 0.002),
        48,
    )


def bore(body: Manifold, radius: float, top: float, depth: float) -> Manifold:
    """Open the mouth."""
    return body - lathe(filleted(np.array([(radius, top + 0.01), (radius, top - depth), (0, top - depth)]), 0.004), 48)


def wine(rng) -> list[Part]:
    """High shoulders, a punt, a long neck with a finish ring under a foil capsule; or a cork."""
    radius, height = rng.uniform(0.034, 0.043), rng.uniform(0.28, 0.34)
    neck, shoulder = rng.uniform(0.0135, 0.016), rng.uniform(0.55, 0.64) * height
    punt = rng.uniform(0.01, 0.03)
    profile = [
        (0, punt),
        (radius * 0.72, 0),
        (radius * 0.93, 0),
        (radius, 0.005),
        (radius, shoulder),
        (neck, shoulder + rng.uniform(0.03, 0.06)),
        (neck, height - 0.022),
        (neck + 0.0022, height - 0.022),
        (neck + 0.0022, height - 0.012),
        (neck, height - 0.012),
        (neck, height),
        (0, height),
    ]
    radii = [0, 0.02, 0.003, 0.006, 0.03, 0.04, 0, 0.001, 0.001, 0, 0.001, 0]
    parts = [Part(lathe(filleted(np.array(profile), radii), AROUND), glass(rng))]
    parts.append(wrapped_label(rng, radius, shoulder * rng.uniform(0.15, 0.3), shoulder * rng.uniform(0.7, 0.9)))
    if rng.uniform() < 0.3:
        return [*parts, Part(cork(neck, height), Material("cork", (196, 158, 110), 0, 0.8))]
    foil = [
        (neck + 0.0006, height - rng.uniform(0.045, 0.075)),
        (neck + 0.0008, height - 0.026),
        (neck + 0.003, height - 0.022),
        (neck + 0.003, height + 0.001),
        (0, height + 0.001),
    ]
    capsule = choose(rng, PLASTIC, 0.6, 0.3, ["red-plastic", "black-plastic", "yellow-plastic", "green-plastic"])
    return [*parts, Part(lathe(filleted(np.array(foil), 0.001), AROUND), capsule)]


def champagne(rng) -> list[Part]:
    """Sloping shoulders, a wide base, foil over half of the neck and a mushroom cork."""
    radius, height = rng.uniform(0.042, 0.048), rng.uniform(0.29, 0.32)
    neck = rng.uniform(0.014, 0.016)
    t = np.linspace(0, 1, 34)
    low, high = 0.36 * height, height - 0.03
    slope = neck + (radius - neck) * (0.5 + 0.5 * np.cos(np.pi * t ** rng.uniform(0.7, 1.0)))
    body = np.concatenate(
        [
            [(0, 0.025), (0.6 * radius, 0.004), (0.88 * radius, 0), (0.97 * radius, 0.002), (radius, 0.008)],
            np.column_stack([slope, low + t * (high - low)]),
            [
                (neck + 0.003, high),
                (neck + 0.003, high + 0.01),
                (neck, high + 0.01),
                (neck, height),
                (0, height),
            ],
        ]
    )
    foil_low = rng.uniform(0.55, 0.75) * height
    keep = low + t * (high - low) > foil_low
    foil = np.column_stack([slope[keep] + 0.0008, (low + t * (high - low))[keep]])
    top = [(neck + 0.004, high), (neck + 0.004, height), (neck + 0.0035, height + 0.012), (0, height + 0.016)]
    parts = [
        Part(lathe(body, AROUND), glass(rng)),
        Part(
            lathe(filleted(np.concatenate([foil, top]), 0.002), AROUND),
            metal(rng, ["brass", "copper", "aluminium"]),
        ),
    ]
    return [*parts, wrapped_label(rng, radius, 0.12 * height, 0.32 * height)]


def beer(rng) -> list[Part]:
    """A longneck or a stubby with a crown cap."""
    radius, height = rng.uniform(0.029, 0.036), rng.uniform(0.17, 0.26)
    shoulder, neck = height * rng.uniform(0.45, 0.6), rng.uniform(0.0125, 0.0145)
    profile = [
        (0, 0.004),
        (0.8 * radius, 0.001),
        (0.92 * radius, 0),
        (radius, 0.004),
        (radius, shoulder),
        (neck + 0.004, shoulder + 0.25 * (height - shoulder)),
        (neck, height - 0.016),
        (neck + 0.001, height - 0.014),
        (neck + 0.001, height - 0.009),
        (neck, height - 0.008),
        (neck, height),
        (0, height),
    ]
    radii = [0, 0, 0.002, 0.004, 0.03, 0.08, 0, 0.0005, 0.0005, 0, 0.002, 0]
    parts = [Part(lathe(filleted(np.array(profile), radii), AROUND), glass(rng))]
    parts.append(Part(crown_cap(neck, height), metal(rng) if rng.uniform() < 0.5 else plastic(rng)))
    return [*parts, wrapped_label(rng, radius, 0.2 * shoulder, rng.uniform(0.75, 0.92) * shoulder)]


def water(rng) -> list[Part]:
    """A PET bottle: ribs pressed into the body, petal foot, ring and knurled cap."""
    radius, height = rng.uniform(0.03, 0.045), rng.uniform(0.19, 0.31)
    neck, shoulder = 0.0125, height * rng.uniform(0.66, 0.76)
    ribs = int(rng.integers(3, 9))
    z = np.linspace(0.012, shoulder, 12 * ribs)
    wave = np.clip(np.cos(2 * np.pi * ribs * (z - 0.012) / (shoulder - 0.012)) - rng.uniform(-0.2, 0.5), 0, None)
    waist = rng.uniform(0, 0.12) * np.exp(-(((z / shoulder - 0.5) / 0.18) ** 2))
    body = np.column_stack([radius * (1 - rng.uniform(0.03, 0.07) * wave - waist), z])
    top = [
        (neck + 0.001, height - 0.028),
        (neck + 0.001, height - 0.023),
        (neck + 0.004, height - 0.023),
        (neck + 0.004, height - 0.021),
        (neck, height - 0.021),
        (neck, height - 0.002),
    ]
    radii = [0, 0.008, *[0] * (len(body) - 1), 0.035, 0.008, 0, 0.0005, 0.0005, 0, 0]
    outline = filleted(
        np.concatenate([[(0.6 * radius, 0), (0.94 * radius, 0)], body[1:], [(radius * 0.9, shoulder + 0.01)], top]),
        radii,
    )
    depth = rng.uniform(0.05, 0.16) * np.exp(-outline[:, 1] / 0.008)
    solid = upright(outline, np.stack([fluted(d, 5, 80) for d in depth]))
    tint = choose(rng, {"clear-pet": (190, 215, 228), "blue-pet": (90, 150, 205), "green-pet": (110, 180, 120)}, 0, 0.1)
    return [Part(solid, tint), Part(screw_cap(0.0155, height - 0.019, 0.02, 36), plastic(rng))]


def soda(rng) -> list[Part]:
    """A contour bottle: waist, fluted belly, crown or screw cap."""
    radius, height = rng.uniform(0.03, 0.036), rng.uniform(0.19, 0.25)
    neck = 0.0125
    knots = np.array(
        [
            (0, 0.86),
            (0.05, 0.98),
            (0.2, 0.86),
            (0.32, 0.83),
            (0.46, 1.0),
            (0.56, 0.98),
            (0.8, 0.5),
            (0.93, 0.385),
            (1, 0.38),
        ]
    )
    t = np.linspace(0, 1, 56)
    curve = np.interp(t, *knots.T)
    kernel = np.hanning(9) / np.hanning(9).sum()
    curve = np.convolve(np.pad(curve, 4, mode="edge"), kernel, mode="valid") * radius
    curve = np.maximum(curve, neck)
    belly = np.exp(-(((t - 0.33) / 0.14) ** 2)) + 0.8 * np.exp(-(((t - 0.62) / 0.06) ** 2))
    flutes = int(rng.integers(8, 15))
    count = 6 * flutes
    depth = rng.uniform(0.02, 0.06) * belly
    section = np.stack([fluted(d, flutes, count) for d in depth])
    solid = upright(np.column_stack([curve, t * height]), section)
    tint = glass(rng) if rng.uniform() < 0.6 else choose(rng, {"cola": (58, 26, 16), "lemon": (190, 196, 90)}, 0, 0.1)
    cap = crown_cap(neck, height) if rng.uniform() < 0.5 else screw_cap(0.0155, height - 0.014, 0.016, 30)
    return [
        Part(solid, tint),
        Part(cap, plastic(rng, ["red-plastic", "white-plastic", "yellow-plastic", "black-plastic"])),
    ]


def squeeze(rng) -> list[Part]:
    """A sauce bottle: oval body, waisted, with a conical or flip cap."""
    wide, deep, height = rng.uniform(0.03, 0.038), rng.uniform(0.62, 0.85), rng.uniform(0.15, 0.22)
    shoulder = height * rng.uniform(0.7, 0.85)
    outline = filleted(
        np.array(
            [
                (0.5 * wide, 0),
                (wide, 0),
                (wide * rng.uniform(0.8, 0.95), 0.5 * shoulder),
                (wide, shoulder),
                (0.014, shoulder + 0.016),
                (0.014, shoulder + 0.03),
            ]
        ),
        [0, 0.006, 0.1, 0.025, 0.004, 0],
    )
    exponent = rng.uniform(2, 3)
    section = superellipse(2, 2, exponent, AROUND)
    # From oval to round towards the neck.
    blend = np.clip((outline[:, 1] - shoulder + 0.02) / 0.03, 0, 1)[:, None, None]
    section = (1 - blend) * section * [deep, 1] + blend * superellipse(2, 2, 2, AROUND)
    body = upright(outline, section)
    top = shoulder + 0.02
    cap = screw_cap(0.018, top, 0.018, 32)
    if rng.uniform() < 0.6:
        nozzle = np.array([(0.008, top + 0.016), (0.003, top + 0.016 + rng.uniform(0.02, 0.035)), (0, top + 0.055)])
        cap += lathe(filleted(nozzle[:2], 0), 32)
    else:
        cap += upright(
            np.array([(0.018, top + 0.015), (0.017, top + 0.032), (0.012, top + 0.034)]),
            superellipse(2, 2, 2.5, 48),
        )
    parts = [
        Part(body, plastic(rng)),
        Part(cap, plastic(rng, ["white-plastic", "green-plastic", "black-plastic"])),
    ]
    return [*parts, flat_label(rng, body, 1.3 * wide, 0.2 * shoulder, 0.75 * shoulder)]


def jug(rng) -> list[Part]:
    """A milk or detergent jug: square, with a handle from the shoulder to the body."""
    half, height = rng.uniform(0.05, 0.075), rng.uniform(0.2, 0.3)
    shoulder, neck = height * rng.uniform(0.55, 0.65), rng.uniform(0.016, 0.022)
    outline = filleted(
        np.array(
            [
                (0.6 * half, 0),
                (half, 0),
                (half, shoulder),
                (neck * 1.3, height - 0.03),
                (neck, height - 0.02),
                (neck, height),
            ]
        ),
        [0, 0.012, 0.04, 0.02, 0.002, 0],
    )
    aspect = rng.uniform(0.62, 1.0)
    blend = np.clip((outline[:, 1] - shoulder) / (height - 0.03 - shoulder), 0, 1)[:, None, None]
    square = superellipse(2, 2, rng.uniform(3.5, 6), AROUND) * [aspect, 1]
    body = upright(outline, (1 - blend) * square + blend * superellipse(2, 2, 2, AROUND))
    grip = rng.uniform(0.009, 0.012)
    reach = half * rng.uniform(0.92, 1.02)
    path = [
        (0, neck * 0.6, height - 0.036),
        (0, reach, height - 0.036),
        (0, reach, shoulder * 0.72),
        (0, half * 0.7, shoulder * 0.55),
    ]
    recess = sweep([(0, half * 1.2, shoulder * 0.5), (0, half * 1.2, height)], superellipse(0.06, 0.9 * half, 3, 32))
    handle = sweep(filleted(np.array(path), 0.025), superellipse(2 * grip, 1.5 * grip, 2.5, 28))
    body = cut(body, [recess]) + handle
    parts = [Part(body, plastic(rng)), Part(screw_cap(neck + 0.004, height - 0.014, 0.018, 40), plastic(rng))]
    if rng.uniform() < 0.6:
        parts.append(flat_label(rng, upright(outline, square), 1.3 * half, 0.15 * shoulder, 0.8 * shoulder))
    return parts


def spirit(rng) -> list[Part]:
    """A square or flask-shaped spirit bottle with a heavy base and a stopper."""
    wide, height = rng.uniform(0.035, 0.055), rng.uniform(0.16, 0.27)
    deep = rng.uniform(0.35, 0.6) if rng.uniform() < 0.5 else 1.0
    shoulder, neck = height * rng.uniform(0.55, 0.7), rng.uniform(0.012, 0.015)
    outline = filleted(
        np.array(
            [
                (0.6 * wide, 0),
                (wide, 0),
                (wide * rng.uniform(0.92, 1.08), shoulder),
                (neck, shoulder + rng.uniform(0.015, 0.03)),
                (neck, height - 0.014),
                (neck + 0.002, height - 0.014),
                (neck + 0.002, height),
                (0.5 * neck, height),
            ]
        ),
        [0, 0.005, 0.012, 0.012, 0, 0.001, 0.002, 0],
    )
    square = superellipse(2, 2, rng.uniform(4, 9), AROUND) * [deep, 1]
    blend = np.clip((outline[:, 1] - shoulder + 0.008) / 0.016, 0, 1)[:, None, None]
    body = upright(outline, (1 - blend) * square + blend * superellipse(2, 2, 2, AROUND))
    stopper = lathe(
        filleted(
            np.array(
                [
                    (neck * 0.7, height - 0.02),
                    (neck * 0.7, height),
                    (neck + 0.004, height + 0.001),
                    (neck + 0.004, height + rng.uniform(0.014, 0.03)),
                    (0, height + 0.03),
                ]
            )[:4],
            [0, 0, 0.001, 0.003],
        ),
        48,
    )
    tint = glass(rng)
    topping = [metal(rng), wood(rng), plastic(rng, ["black-plastic"])][rng.integers(3)]
    parts = [Part(body, tint), Part(stopper, topping, across if topping.picture else None)]
    return [*parts, flat_label(rng, body, 1.4 * wide, 0.15 * shoulder, 0.8 * shoulder)]


def medicine(rng) -> list[Part]:
    """A pill bottle or a dropper: short and wide, with a big ribbed cap or a rubber bulb."""
    radius, height = rng.uniform(0.018, 0.032), rng.uniform(0.055, 0.1)
    shoulder = height * rng.uniform(0.74, 0.84)
    dropper = rng.uniform() < 0.5
    neck = radius * (0.45 if dropper else rng.uniform(0.7, 0.85))
    outline = filleted(
        np.array(
            [
                (0.7 * radius, 0),
                (radius, 0),
                (radius, shoulder),
                (neck, shoulder + 0.2 * (height - shoulder)),
                (neck, height),
            ]
        ),
        [0, 0.003, 0.007, 0.003, 0],
    )
    parts = [
        Part(
            lathe(outline, AROUND),
            glass(rng) if dropper else plastic(rng, ["white-plastic", "orange-plastic", "teal-plastic"]),
        )
    ]
    low = shoulder + 0.35 * (height - shoulder)
    cap = screw_cap(neck + 0.003, low, height - low + 0.006, 44)
    if dropper:
        top = height + 0.005
        bulb = [
            (neck * 0.7, top),
            (neck * 0.62, top + 0.012),
            (neck * 0.75, top + 0.02),
            (neck * 0.5, top + 0.034),
            (0, top + 0.036),
        ]
        parts.append(Part(lathe(filleted(np.array(bulb), 0.006), 48), Material("rubber", (40, 38, 38), 0, 0.8)))
    parts.append(Part(cap, plastic(rng, ["white-plastic", "black-plastic"])))
    return [*parts, wrapped_label(rng, radius, 0.15 * shoulder, 0.85 * shoulder)]


def soap(rng) -> list[Part]:
    """A dispenser: oval or round body and a pump with a spout."""
    wide, height = rng.uniform(0.03, 0.04), rng.uniform(0.11, 0.16)
    deep = rng.uniform(0.6, 1.0)
    outline = filleted(
        np.array(
            [
                (0.6 * wide, 0),
                (wide, 0),
                (wide * rng.uniform(0.75, 1), height * 0.85),
                (0.013, height),
                (0.013, height + 0.012),
            ]
        ),
        [0, 0.006, 0.03, 0.004, 0],
    )
    blend = np.clip((outline[:, 1] - height * 0.8) / (0.2 * height), 0, 1)[:, None, None]
    oval = superellipse(2, 2, rng.uniform(2, 4.5), AROUND) * [deep, 1]
    body = upright(outline, (1 - blend) * oval + blend * superellipse(2, 2, 2, AROUND))
    top = height + rng.uniform(0.035, 0.05)
    spout = [(0, 0, top + 0.003), (0, 0.036, top + 0.001), (0, 0.044, top - 0.012)]
    pump = union(
        [
            screw_cap(0.0165, height + 0.001, 0.016, 36),
            rod((0, 0, height + 0.01), (0, 0, top), 0.0045),
            lathe(filleted(np.array([(0.011, top - 0.004), (0.011, top + 0.008), (0, top + 0.008)]), 0.002), 36),
            sweep(filleted(np.array(spout), 0.008), superellipse(0.011, 0.008, 2.5, 24)),
        ]
    )
    parts = [
        Part(body, plastic(rng) if rng.uniform() < 0.6 else glass(rng)),
        Part(pump, plastic(rng, ["white-plastic", "black-plastic"])),
    ]
    return [*parts, flat_label(rng, body, 1.2 * wide, 0.2 * height, 0.7 * height)] if rng.uniform() < 0.6 else parts


def spray(rng) -> list[Part]:
    """A cleaner with a trigger head."""
    wide, height = rng.uniform(0.036, 0.044), rng.uniform(0.17, 0.22)
    deep = rng.uniform(0.55, 0.75)
    outline = filleted(
        np.array(
            [
                (0.6 * wide, 0),
                (wide, 0),
                (wide, 0.5 * height),
                (0.018, 0.72 * height),
                (0.0135, height - 0.01),
                (0.0135, height),
            ]
        ),
        [0, 0.006, 0.03, 0.05, 0.004, 0],
    )
    blend = np.clip((outline[:, 1] - 0.5 * height) / (0.25 * height), 0, 1)[:, None, None]
    oval = superellipse(2, 2, rng.uniform(2.2, 3.5), AROUND) * [deep, 1]
    body = upright(outline, (1 - blend) * oval + blend * superellipse(2, 2, 2, AROUND))
    h = height
    head = sweep(
        filleted(
            np.array([(0, -0.034, h + 0.034), (0, 0.0, h + 0.042), (0, 0.045, h + 0.04), (0, 0.06, h + 0.038)]),
            0.02,
        ),
        superellipse(0.022, 0.024, 3, 32),
    )
    collar = screw_cap(0.0165, h - 0.012, 0.018, 36) + rod((0, 0, h), (0, 0, h + 0.036), 0.012)
    nozzle = turned(np.array([(0.0085, 0), (0.0075, 0.012)]), (0, 0.056, h + 0.038), (0, 1, 0), 24)
    path = filleted(
        np.array([(0, 0.03, h + 0.034), (0, 0.04, h + 0.012), (0, 0.03, h - 0.02), (0, 0.036, h - 0.03)]),
        0.02,
    )
    trigger = sweep(path, superellipse(0.014, 0.005, 3, 24))
    parts = [
        Part(body, plastic(rng)),
        Part(union([head, collar]), plastic(rng, ["white-plastic", "black-plastic", "blue-plastic"])),
        Part(union([trigger, nozzle]), Material("trigger", tuple(int(c) for c in rng.integers(40, 230, 3)))),
    ]
    return [*parts, flat_label(rng, body, 1.3 * wide, 0.08 * height, 0.42 * height)]


def sports(rng) -> list[Part]:
    """A flask or sports bottle: steel body, lid with a carrying loop or a straw."""
    radius, height = rng.uniform(0.032, 0.04), rng.uniform(0.19, 0.27)
    neck = radius * rng.uniform(0.62, 0.85)
    outline = filleted(
        np.array([(0.8 * radius, 0), (radius, 0), (radius, height * 0.82), (neck, height * 0.9), (neck, height)]),
        [0, 0.003, 0.03, 0.01, 0],
    )
    body = lathe(outline, AROUND)
    lid = screw_cap(neck + 0.002, height * 0.915, 0.03, 30)
    top = height * 0.915 + 0.03
    if rng.uniform() < 0.6:
        span = neck * 0.9
        path = [
            (0, -span, top - 0.012),
            (0, -span, top + 0.026),
            (0, span, top + 0.026),
            (0, span, top - 0.012),
        ]
        lid += sweep(filleted(np.array(path), 0.018), superellipse(0.014, 0.006, 3, 24))
    else:
        spout = filleted(
            np.array(
                [
                    (0.011, top - 0.002),
                    (0.011, top + 0.014),
                    (0.008, top + 0.018),
                    (0.009, top + 0.03),
                    (0, top + 0.03),
                ]
            ),
            0.002,
        )
        lid += lathe(spout, 40)
    coat = metal(rng, ["steel", "aluminium"]) if rng.uniform() < 0.4 else plastic(rng)
    parts = [Part(body, coat), Part(lid, plastic(rng, ["black-plastic", "white-plastic", "teal-plastic"]))]
    band = rng.uniform(0.2, 0.5) * height
    ring = lathe(
        np.array(
            [
                (radius - 0.002, band),
                (radius + 0.0012, band),
                (radius + 0.0012, band + 0.05),
                (radius - 0.002, band + 0.05),
            ]
        ),
        AROUND,
    )
    return [*parts, Part(ring, Material("grip", (60, 60, 64), 0, 0.8))]


def growler(rng) -> list[Part]:
    """A stoneware or glass jug with a finger ring at the neck."""
    radius, height = rng.uniform(0.05, 0.075), rng.uniform(0.2, 0.28)
    shoulder, neck = height * rng.uniform(0.5, 0.62), rng.uniform(0.015, 0.02)
    profile = filleted(
        np.array(
            [
                (0, 0.006),
                (0.8 * radius, 0.0),
                (radius, 0),
                (radius, shoulder),
                (neck, height * 0.84),
                (neck, height - 0.012),
                (neck + 0.004, height - 0.012),
                (neck + 0.004, height),
                (0, height),
            ]
        ),
        [0, 0, 0.008, 0.06, 0.02, 0.001, 0.003, 0.003, 0],
    )
    ring = rng.uniform(0.022, 0.03)
    angle = np.linspace(-1.9, 1.9, 30)
    centre = np.array([0, neck + ring * 0.75, height * 0.84])
    path = centre + ring * np.column_stack([np.zeros(30), np.cos(angle), np.sin(angle)])
    handle = sweep(path, superellipse(0.014, 0.009, 2.5, 24))
    stone = {"stoneware": (196, 180, 150), "cream-glaze": (228, 216, 186), "slate-glaze": (80, 92, 104)}
    material = glass(rng) if rng.uniform() < 0.5 else choose(rng, stone, 0, 0.35)
    open_body = bore(lathe(profile, AROUND) + handle, neck - 0.004, height, rng.uniform(0.03, 0.06))
    if rng.uniform() < 0.5:
        return [
            Part(open_body, material),
            Part(cork(neck, height), Material("cork", (196, 158, 110), 0, 0.8)),
        ]
    return [Part(open_body, material), wrapped_label(rng, radius, 0.2 * shoulder, 0.8 * shoulder, 140)]


def carafe(rng) -> list[Part]:
    """An open, round-bellied bottle of glass, like a vase, flask or decanter."""
    radius, height = rng.uniform(0.045, 0.065), rng.uniform(0.2, 0.28)
    neck, lip = rng.uniform(0.014, 0.019), rng.uniform(0.018, 0.026)
    belly = rng.uniform(0.3, 0.42) * height
    t = np.linspace(0, np.pi, 40)
    low = radius * rng.uniform(0.45, 0.65)
    outline = np.concatenate(
        [[(0, 0.003), (low, 0)], np.column_stack([radius * np.sin(t), belly * (1 - np.cos(t))])[9:36]]
    )
    outline = np.concatenate(
        [
            outline[outline[:, 0] >= neck * 0.9][0:],
            [(neck, belly * 2.05), (neck, height - 0.01), (lip, height)],
        ]
    )
    outline[0] = (low, 0)
    outline = filleted(outline, [0] + [0.01] * (len(outline) - 3) + [0.03, 0])
    body = bore(lathe(outline, AROUND), neck - 0.0035, height, rng.uniform(0.3, 0.5) * (height - belly))
    parts = [Part(body, glass(rng))]
    if rng.uniform() < 0.5:
        ball = lathe(
            filleted(
                np.array(
                    [
                        (neck - 0.004, height - 0.02),
                        (neck - 0.0035, height + 0.002),
                        (0.008, height + 0.006),
                        (0.018, height + 0.022),
                        (0.006, height + 0.042),
                        (0, height + 0.042),
                    ]
                ),
                0.012,
            ),
            48,
        )
        parts.append(Part(ball, glass(rng) if rng.uniform() < 0.5 else wood(rng), across))
    return parts


def perfume(rng) -> list[Part]:
    """A heavy glass block with a collar and a cap."""
    wide, height, deep = rng.uniform(0.025, 0.036), rng.uniform(0.05, 0.085), rng.uniform(0.016, 0.026)
    if rng.uniform() < 0.5:
        rim = rounded_rectangle(2 * deep, 2 * wide, rng.uniform(0.003, 0.01), 8)
    else:
        rim = superellipse(2 * deep, 2 * wide, rng.uniform(1.6, 3), AROUND)
    inset = filleted(
        np.array([(0.9, 0), (1, 0.004), (rng.uniform(0.85, 1.05), height - 0.005), (0.86, height)]),
        [0, 0.003, 0.004, 0],
    )
    body = upright(inset, rim)
    collar = lathe(np.array([(0.009, height - 0.002), (0.009, height + 0.006)]), 40)
    low, cap_height = height + 0.004, rng.uniform(0.018, 0.034)
    if rng.uniform() < 0.5:
        cap = lathe(filleted(np.array([(0.013, low), (0.0125, low + cap_height), (0, low + cap_height)]), 0.002), 56)
    else:
        cap = upright(
            filleted(np.array([(1, low), (0.9, low + cap_height), (0.6, low + cap_height)]), [0, 0.003, 0]),
            rounded_rectangle(0.022, 0.026, 0.004, 8),
        )
    parts = [Part(body, glass(rng)), Part(collar, metal(rng, ["brass", "aluminium"]))]
    return [*parts, Part(cap, plastic(rng, ["black-plastic", "white-plastic", "pink-plastic"]))]


STYLES = (
    wine,
    jug,
    beer,
    water,
    wine,
    spray,
    spirit,
    growler,
    squeeze,
    medicine,
    soap,
    champagne,
    soda,
    sports,
    carafe,
    perfume,
)
