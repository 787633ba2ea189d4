"""Knives: lofted blades with bevels, points and teeth; bolsters, guards, handles with rivets, folders.

Metres; the long axis is y with the tip towards +y, the edge faces -z, the flat side faces +x. A blade begins
at y = 0 and its handle lies at y < 0; the spine at the handle is at z = 0.
"""

import numpy as np
from manifold3d import Manifold

from palpate.shapes.assembly import Part
from palpate.shapes.materials import (
    DARK_METAL,
    Material,
    across,
    choose,
    dark_metal,
    metal,
    plastic,
    polymer,
    wood,
)
from palpate.shapes.solids import (
    along_y,
    box,
    cut,
    filleted,
    loft,
    prism,
    rod,
    superellipse,
    sweep,
    turned,
    union,
)

# A sharp edge's thickness: what a whetted edge has is below what a mesh in float32 and a sensor can tell.
EDGE = 0.0004
# Height of a blade at its very tip.
POINT = 0.0012
STATIONS = 60


def blade(y, spine, edge, thickness, bevel: float = 0.5, double: bool = False) -> Manifold:
    """A blade along y.

    y, spine, edge: (k,) positions, heights z of the back and of the edge; thickness: (k,) or one, at the
    back; bevel: share of the height that is ground to the edge; double: ground to both sides (a dagger).
    """
    # Where back and edge would meet or cross, the back stays above.
    height = np.maximum(spine - edge, POINT)
    thickness = np.broadcast_to(np.minimum(thickness, height), y.shape)
    sharp = np.minimum(EDGE, thickness)
    spine_half = sharp / 2 if double else 0.94 * thickness / 2
    ground = edge + bevel * height
    back = spine - (0.5 if double else 0.04) * height
    if double:
        ground = back = (spine + edge) / 2
    columns = [
        (spine_half, edge + height),
        (-spine_half, edge + height),
        (-thickness / 2, back),
        (-thickness / 2, ground - 1e-5),
        (-sharp / 2, edge),
        (sharp / 2, edge),
        (thickness / 2, ground - 1e-5),
        (thickness / 2, back),
    ]
    return loft(np.stack([np.stack([x, y, z], -1) for x, z in columns], axis=1))


def ends(length: float, heel: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Stations from the heel to the tip, denser at the tip: positions y (k,) and the same from 0 to 1."""
    t = 1 - (1 - np.linspace(0, 1, STATIONS)) ** 1.5
    return heel + t * (length - heel), t


def teeth(y0: float, y1: float, pitch: float, depth: float, height, radius_factor: float = 0.75) -> list[Manifold]:
    """Tools that cut scallops into an edge; height(y) is where the edge lies."""
    count = max(2, int((y1 - y0) / pitch))
    radius = radius_factor * pitch
    tools = []
    for y in y0 + (np.arange(count) + 0.5) * (y1 - y0) / count:
        z = float(height(y)) + depth - radius
        tools.append(rod((-0.01, y, z), (0.01, y, z), radius, segments=20))
    return tools


def saw(y0: float, y1: float, pitch: float, depth: float, height) -> list[Manifold]:
    """Tools that cut triangular teeth into a back."""
    count = max(2, int((y1 - y0) / pitch))
    tools = []
    for y in y0 + (np.arange(count) + 0.5) * (y1 - y0) / count:
        z = float(height(y))
        tools.append(prism([(y - 0.42 * pitch, z + 0.002), (y, z - depth), (y + 0.42 * pitch, z + 0.002)], 0.02))
    return tools


def rivets(positions, radius: float, half: float) -> Manifold:
    """Pins (y, z) across the handle, flush within a tenth of a millimetre."""
    return union([rod((-half, y, z), (half, y, z), radius, segments=24) for y, z in positions])


def scales(rng, length: float, height: float, width: float, drop: float = 0.0) -> tuple[Manifold, list]:
    """A kitchen-knife handle behind y = 0, its butt swelling; and where its rivets sit."""
    belly, butt = rng.uniform(0.78, 0.92) * height, rng.uniform(1.05, 1.35) * height
    outline = filleted(
        np.array(
            [
                (0, 0),
                (-0.5 * length, -0.06 * height - 0.3 * drop),
                (-0.9 * length, -drop),
                (-length, -drop - 0.4 * butt),
                (-0.93 * length, -drop - butt),
                (-0.72 * length, -0.9 * height - 0.8 * drop),
                (-0.4 * length, -belly - 0.3 * drop),
                (0, -height),
            ]
        ),
        [0.002, 0.1, 0.012, 0.008, 0.01, 0.03, 0.06, 0.002],
        closed=True,
    )
    middle = [(-share * length, -0.47 * height - share * drop * 0.8) for share in (0.16, 0.48, 0.8)]
    return prism(outline, width, 0.3 * width), middle


def handle_material(rng) -> Material:
    return wood(rng) if rng.uniform() < 0.5 else (plastic(rng) if rng.uniform() < 0.5 else polymer(rng))


def part(solid: Manifold, material: Material) -> Part:
    """A part whose picture, if it has one, lies across its side."""
    return Part(solid, material, across if material.picture else None)


def kitchen_handle(rng, height: float, blade_steel: Manifold, bolster: bool) -> list[Part]:
    """Scales, rivets and perhaps a bolster, joined to a blade."""
    length, width = rng.uniform(0.1, 0.13), min(rng.uniform(0.014, 0.02), 0.85 * height)
    grip, pins = scales(rng, length, height, width, rng.uniform(0, 0.012))
    steel = [blade_steel, rivets(pins, rng.uniform(0.0028, 0.0042), width / 2 + 0.0002)]
    # The tang shows along the back of the handle.
    steel.append(box((0.0026, 0.12 * length, 0.6 * height), (0, -0.04 * length, -0.5 * height)))
    if bolster:
        steel.append(
            along_y(
                [
                    (-0.012, -height, 0.0002, width * 1.02),
                    (0.0, -height, 0.0002, width),
                    (0.012, -0.98 * height, -0.0002, 0.003),
                ],
                3.2,
                16,
                32,
            )
        )
    return [Part(union(steel), metal(rng, ["steel", "aluminium"])), part(grip, handle_material(rng))]


def chef(rng) -> list[Part]:
    """A cook's knife: a tall heel and a curved edge; or long and slim (a slicer)."""
    length, height = rng.uniform(0.15, 0.26), rng.uniform(0.026, 0.052)
    y, t = ends(length)
    spine = -height * rng.uniform(0.25, 0.5) * t ** rng.uniform(2.5, 6)
    edge = -height + (height + spine[-1]) * t ** rng.uniform(2.2, 4.5)
    solid = blade(y, spine, edge, rng.uniform(0.0022, 0.0034) * (1 - 0.6 * t), rng.uniform(0.4, 0.8))
    return kitchen_handle(rng, rng.uniform(0.02, 0.026), solid, rng.uniform() < 0.7)


def santoku(rng) -> list[Part]:
    """A straight edge, a dropped back, hollows along the side."""
    length, height = rng.uniform(0.14, 0.18), rng.uniform(0.042, 0.052)
    y, t = ends(length)
    spine = -height * 0.92 * np.clip((t - 0.72) / 0.28, 0, 1) ** 2.2
    edge = -height + 0.1 * height * t**3
    thickness = rng.uniform(0.0022, 0.003)
    solid = blade(y, spine, edge, thickness * (1 - 0.4 * t), 0.5)
    if rng.uniform() < 0.7:
        hollow = Manifold.sphere(1, 24).scale((0.0009, 0.0035, 0.012))
        rows = [
            hollow.translate((side * thickness * 0.48, at, -0.62 * height))
            for side in (1, -1)
            for at in np.arange(0.02, 0.78 * length, 0.011)
        ]
        solid = cut(solid, rows)
    return kitchen_handle(rng, rng.uniform(0.021, 0.026), solid, rng.uniform() < 0.4)


def bread(rng) -> list[Part]:
    """A long serrated knife."""
    length, height = rng.uniform(0.2, 0.27), rng.uniform(0.028, 0.038)
    y, t = ends(length)
    bend = rng.uniform(0, 0.15)
    spine = -height * 0.75 * np.clip((t - 0.85) / 0.15, 0, 1) ** 2 + bend * height * np.sin(np.pi * t)
    edge = -height + bend * height * np.sin(np.pi * t)
    solid = blade(y, spine, edge, 0.0024 * (1 - 0.3 * t), 0.45)
    pitch = rng.uniform(0.005, 0.009)
    tools = teeth(0.012, 0.95 * length, pitch, 0.32 * pitch, lambda at: np.interp(at, y, edge))
    return kitchen_handle(rng, rng.uniform(0.021, 0.026), cut(solid, tools), rng.uniform() < 0.3)


def paring(rng) -> list[Part]:
    """A small kitchen knife: spear point, sheep's foot or a bird's beak."""
    length, height = rng.uniform(0.07, 0.1), rng.uniform(0.016, 0.022)
    y, t = ends(length)
    shape = rng.integers(3)
    spine = -height * [0.45 * t**2.5, 0.95 * np.clip((t - 0.6) / 0.4, 0, 1) ** 2, 0.9 * t**2][shape]
    edge = -height * [1 - 0.55 * t**3, 1 - 0.02 * t, 1 - 0.25 * np.sin(np.pi * t)][shape]
    solid = blade(y, spine, edge, 0.0018 * (1 - 0.4 * t), 0.7)
    return kitchen_handle(rng, rng.uniform(0.015, 0.019), solid, rng.uniform() < 0.4)


def cleaver(rng) -> list[Part]:
    """A rectangular blade with a hole to hang it."""
    length, height = rng.uniform(0.15, 0.2), rng.uniform(0.07, 0.1)
    rise = rng.uniform(0, 0.12)
    y, t = ends(length)
    corner = 0.004 * np.clip((t - 0.96) / 0.04, 0, 1) ** 2
    solid = blade(
        y,
        rise * height * t - corner,
        -height + 0.06 * height * t**2 + corner,
        rng.uniform(0.0025, 0.0045),
        rng.uniform(0.15, 0.4),
    )
    hole = rod((-0.01, 0.9 * length, -0.16 * height), (0.01, 0.9 * length, -0.16 * height), 0.006)
    return kitchen_handle(rng, rng.uniform(0.024, 0.03), solid - hole, rng.uniform() < 0.3)


def steak(rng) -> list[Part]:
    """A slim serrated table knife with a narrow handle."""
    length, height = rng.uniform(0.1, 0.13), rng.uniform(0.015, 0.021)
    y, t = ends(length)
    spine = -0.9 * height * t ** rng.uniform(3, 6)
    edge = -height + 0.08 * height * t
    pitch = rng.uniform(0.003, 0.0045)
    solid = blade(y, spine, edge, 0.0016, 0.5)
    solid = cut(solid, teeth(0.2 * length, 0.92 * length, pitch, 0.3 * pitch, lambda at: np.interp(at, y, edge)))
    return kitchen_handle(rng, rng.uniform(0.014, 0.018), solid, rng.uniform() < 0.3)


def table(rng) -> list[Part]:
    """A dinner or butter knife, all of one metal."""
    length, height = rng.uniform(0.09, 0.12), rng.uniform(0.016, 0.024)
    y, t = ends(length)
    spine = -0.9 * height * np.clip((t - 0.8) / 0.2, 0, 1) ** 2.5
    edge = -height * (0.8 + 0.2 * np.sin(np.pi * np.clip(t * 1.2, 0, 1)))
    solid = blade(y, spine, edge, 0.0022 * (1 - 0.3 * t), 0.8)
    grip, tall, wide = rng.uniform(0.09, 0.12), rng.uniform(0.013, 0.018), rng.uniform(0.006, 0.01)
    middle = -0.45 * height
    stations = [
        (-grip, middle - 0.3 * tall, middle + 0.3 * tall, wide * 0.6),
        (-grip + 0.006, middle - tall / 2, middle + tall / 2, wide),
        (-0.5 * grip, middle - 0.4 * tall, middle + 0.4 * tall, wide * 0.9),
        (-0.01, middle - 0.26 * tall, middle + 0.26 * tall, wide * 0.7),
        (0.006, middle - 0.42 * height, middle + 0.42 * height, 0.0018),
    ]
    handle = along_y(stations, rng.uniform(2, 3), 50, 32)
    if rng.uniform() < 0.6:
        return [Part(solid + handle, metal(rng, ["steel", "aluminium", "brass"]))]
    ring = along_y(
        [
            (-0.014, middle - 0.3 * tall, middle + 0.3 * tall, wide * 0.9),
            (-0.009, middle - 0.3 * tall, middle + 0.3 * tall, wide * 0.9),
        ],
        2.4,
        4,
        32,
    )
    return [Part(solid + ring, metal(rng)), part(handle.trim_by_plane((0, -1, 0), 0.008), plastic(rng))]


def folder(rng) -> list[Part]:
    """A pocket knife, open or half open: scales, liners, pivot, clip, a blade with a hole or a stud."""
    length, height = rng.uniform(0.07, 0.095), rng.uniform(0.02, 0.028)
    y, t = ends(length)
    spine = -height * rng.uniform(0.3, 0.6) * t ** rng.uniform(1.5, 4)
    edge = -height + (height + spine[-1]) * t ** rng.uniform(2, 4)
    solid = blade(y, spine, edge, 0.003 * (1 - 0.5 * t), 0.6)
    solid += box((0.003, 0.03, 0.75 * height), (0, -0.012, -0.45 * height))
    if rng.uniform() < 0.4:
        pitch = 0.0045
        solid = cut(solid, teeth(0.004, 0.45 * length, pitch, 0.35 * pitch, lambda at: np.interp(at, y, edge)))
    if rng.uniform() < 0.5:
        hole = rod((-0.01, 0.016, -0.28 * height), (0.01, 0.016, -0.28 * height), 0.0042)
        solid -= hole
    else:
        solid += rod((-0.006, 0.012, -0.3 * height), (0.006, 0.012, -0.3 * height), 0.0028)
    grip, tall = length * rng.uniform(1.15, 1.3), height * rng.uniform(0.95, 1.15)
    pivot = np.array([0, -0.01, -0.5 * height])
    angle = 0.0 if rng.uniform() < 0.65 else rng.uniform(25, 65)
    solid = solid.translate(-pivot).rotate((angle, 0, 0)).translate(pivot)
    middle = -0.5 * height
    outline = filleted(
        np.array(
            [
                (0.002, middle + 0.5 * tall),
                (-0.5 * grip, middle + 0.42 * tall),
                (-grip, middle + 0.45 * tall),
                (-grip - 0.004, middle - 0.5 * tall),
                (-0.7 * grip, middle - 0.55 * tall),
                (-0.45 * grip, middle - 0.4 * tall),
                (-0.2 * grip, middle - 0.5 * tall),
                (0.002, middle - 0.5 * tall),
            ]
        ),
        [0.009, 0.1, 0.01, 0.012, 0.03, 0.03, 0.03, 0.009],
        closed=True,
    )
    slot = box((0.0034, grip * 0.96, tall), (0, -0.46 * grip, middle - 0.2 * tall))
    width = rng.uniform(0.011, 0.014)
    body = prism(outline, width, 0.0025) - slot
    pins = [(-0.01, middle), (-0.55 * grip, middle + 0.1 * tall), (-0.92 * grip, middle)]
    steel = [solid, rivets(pins, 0.0032, width / 2 + 0.0005)]
    if rng.uniform() < 0.6:
        clip = filleted(
            np.array(
                [
                    (-0.95 * grip, 0.0022),
                    (-0.95 * grip, -0.0022),
                    (-0.4 * grip, -0.0022),
                    (-0.4 * grip, 0.0022),
                ]
            )
            + [0, middle],
            0.002,
            closed=True,
        )
        steel.append(
            prism(clip, 0.0012).translate((-width / 2 - 0.0012, 0, 0))
            + box((0.003, 0.006, 0.0044), (-width / 2 - 0.0005, -0.92 * grip, middle))
        )
    steel_look = metal(rng, ["steel"]) if rng.uniform() < 0.7 else dark_metal(rng)
    return [Part(union(steel), steel_look), part(body, handle_material(rng))]


def multitool(rng) -> list[Part]:
    """A Swiss pocket knife: red or coloured scales, a blade out, often a second tool."""
    grip, tall = rng.uniform(0.083, 0.095), rng.uniform(0.02, 0.026)
    width = rng.uniform(0.013, 0.022)
    stadium = filleted(np.array([(0, 0.5), (0, -0.5), (-1, -0.5), (-1, 0.5)]) * [grip, tall], 0.49 * tall, closed=True)
    red = Material("red-scales", (170, 20, 26), 0, 0.25)
    look = red if rng.uniform() < 0.5 else plastic(rng)
    core = width - 0.007
    shells = [prism(stadium, 0.0042, 0.0015).translate((side * (width / 2 - 0.0021), 0, 0)) for side in (1, -1)]
    liner = cut(
        prism(stadium, core),
        [
            box((0.0022, grip * 0.9, tall), (x, -0.46 * grip, 0.3 * tall))
            for x in np.arange(-core / 2 + 0.003, core / 2 - 0.001, 0.0044)
        ],
    )
    length, height = grip * 0.75, 0.6 * tall
    y, t = ends(length)
    spine = 0.5 * height - 0.5 * height * t**3
    edge = -0.5 * height + 0.45 * height * t**2.5
    main = blade(y, spine, edge, 0.002, 0.6) + box((0.002, 0.02, 0.6 * height), (0, -0.008, 0))
    angle = rng.choice([0.0, 0.0, 30.0, 60.0])
    main = main.rotate((angle, 0, 0)).translate((0.2 * core, -0.004, 0.1 * tall))
    tools = [main, liner, rivets([(-0.01, 0), (-grip + 0.01, 0)], 0.0026, width / 2 - 0.001)]
    if rng.uniform() < 0.7:
        driver = prism(
            filleted(np.array([(0, 0.004), (0.035, 0.0025), (0.037, -0.0025), (0, -0.004)]), 0.001, closed=True),
            0.0022,
        )
        driver = driver.rotate((180 - rng.uniform(50, 130), 0, 0)).translate((-0.25 * core, -grip + 0.008, 0.2 * tall))
        tools.append(driver)
    if rng.uniform() < 0.6:
        turn = np.linspace(0, 2 * np.pi, 30)[:-1]
        ring = np.column_stack([np.zeros(29), -grip - 0.004 + 0.007 * np.cos(turn), 0.007 * np.sin(turn)])
        tools.append(hoop(ring, 0.0008))
    return [Part(union(tools), metal(rng, ["steel"])), Part(union(shells), look)]


def hoop(path: np.ndarray, radius: float) -> Manifold:
    """A closed ring of wire through path (k, 3), which lies in a plane of constant x."""
    centre = path.mean(axis=0)
    out = path - centre
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    outer = path[:, 1:] + radius * out[:, 1:]
    inner = path[:, 1:] - radius * out[:, 1:]
    return prism(outer, 2 * radius, 0.6 * radius) - prism(inner, 3 * radius)


def hunting(rng) -> list[Part]:
    """A bowie: clip point, cross guard, a handle of wood or stacked rings, a pommel."""
    length, height = rng.uniform(0.13, 0.24), rng.uniform(0.028, 0.042)
    y, t = ends(length)
    clip = rng.uniform(0.6, 0.75)
    spine = -0.62 * height * np.clip((t - clip) / (1 - clip), 0, 1) ** 0.8
    edge = -height - 0.04 * height * np.sin(np.pi * t) + 0.38 * height * np.clip((t - 0.6) / 0.4, 0, 1) ** 2.2
    solid = blade(y, spine, edge, rng.uniform(0.0035, 0.005) * (1 - 0.5 * t), 0.5)
    middle = -0.5 * height
    groove = sweep(
        [(0, 0.01, middle + 0.28 * height), (0, clip * length, middle + 0.28 * height)],
        superellipse(0.0016, 0.1 * height, 2, 16),
    )
    if rng.uniform() < 0.6:
        solid = cut(solid, [groove.translate((side * 0.0024, 0, 0)) for side in (1, -1)])
    guard_height = height * rng.uniform(1.4, 2.0)
    guard = along_y(
        [
            (-0.004, middle - guard_height / 2, middle + guard_height / 2, 0.013),
            (0.004, middle - guard_height / 2, middle + guard_height / 2, 0.013),
        ],
        4,
        4,
        40,
    )
    grip, tall, wide = rng.uniform(0.1, 0.12), rng.uniform(0.026, 0.032), rng.uniform(0.02, 0.025)
    stations = [
        (-0.003, middle - 0.4 * tall, middle + 0.4 * tall, 0.85 * wide),
        (-0.5 * grip, middle - 0.55 * tall, middle + 0.5 * tall, wide),
        (-0.8 * grip, middle - 0.45 * tall, middle + 0.42 * tall, 0.85 * wide),
        (-grip, middle - 0.55 * tall, middle + 0.48 * tall, 0.95 * wide),
    ]
    handle = along_y(stations[::-1], 2.3, 40, 40)
    pommel = along_y(
        [
            (-grip - 0.012, middle - 0.35 * tall, middle + 0.3 * tall, 0.6 * wide),
            (-grip - 0.006, middle - 0.55 * tall, middle + 0.5 * tall, wide),
            (-grip + 0.002, middle - 0.55 * tall, middle + 0.48 * tall, wide),
        ],
        2.5,
        16,
        40,
    )
    fittings = metal(rng, ["brass", "steel"])
    look = metal(rng, ["steel"])
    return [Part(solid, look), Part(union([guard, pommel]), fittings), part(handle, handle_material(rng))]


def combat(rng) -> list[Part]:
    """A black field knife: saw back, half-serrated edge, ringed polymer handle, guard with a hole."""
    length, height = rng.uniform(0.13, 0.19), rng.uniform(0.028, 0.036)
    y, t = ends(length)
    clip = rng.uniform(0.68, 0.8)
    spine = -0.5 * height * np.clip((t - clip) / (1 - clip), 0, 1)
    edge = -height + 0.5 * height * np.clip((t - 0.7) / 0.3, 0, 1) ** 2
    solid = blade(y, spine, edge, rng.uniform(0.004, 0.005) * (1 - 0.3 * t), 0.45)
    tools = saw(
        0.02,
        rng.uniform(0.4, 0.6) * length,
        rng.uniform(0.006, 0.009),
        0.004,
        lambda at: np.interp(at, y, spine),
    )
    if rng.uniform() < 0.6:
        tools += teeth(0.012, 0.4 * length, 0.0055, 0.002, lambda at: np.interp(at, y, edge))
    solid = cut(solid, tools)
    middle = -0.5 * height
    plate = filleted(
        np.array(
            [
                (-0.003, middle + 0.95 * height),
                (-0.003, middle - 0.95 * height),
                (0.003, middle - 0.95 * height),
                (0.003, middle + 0.95 * height),
            ]
        ),
        0.0012,
        closed=True,
    )
    guard = prism(plate, 0.022, 0.002)
    grip, wide = rng.uniform(0.105, 0.125), rng.uniform(0.023, 0.028)
    ribs = int(rng.integers(6, 11))
    s = np.linspace(0, 1, 90)
    swell = 1 + 0.06 * np.cos(2 * np.pi * ribs * s) - 0.06 * (2 * s - 1) ** 2
    tall = 1.2 * wide * swell
    rings = np.column_stack([-0.002 - grip * s, middle - tall / 2, middle + tall / 2, wide * swell])
    handle = along_y(rings[::-1], 2.4, 100, 36)
    pommel = prism(
        filleted(
            np.array(
                [
                    (-grip - 0.014, middle + 0.013),
                    (-grip - 0.014, middle - 0.013),
                    (-grip + 0.002, middle - 0.015),
                    (-grip + 0.002, middle + 0.015),
                ]
            ),
            0.003,
            closed=True,
        ),
        0.021,
        0.003,
    )
    look = choose(rng, DARK_METAL, 0.6, 0.5) if rng.uniform() < 0.7 else metal(rng, ["steel"])
    return [
        Part(union([solid, guard, pommel]), look),
        part(handle, polymer(rng) if rng.uniform() < 0.7 else wood(rng)),
    ]


def dagger(rng) -> list[Part]:
    """Double-edged and symmetrical, with a cross guard and a round pommel."""
    length, height = rng.uniform(0.15, 0.26), rng.uniform(0.022, 0.036)
    y, t = ends(length)
    half = height / 2 * (1 - 0.35 * t - 0.62 * t ** rng.uniform(4, 9))
    middle = -0.5 * height
    solid = blade(y, middle + half, middle - half, rng.uniform(0.004, 0.006) * (1 - 0.6 * t), double=True)
    reach, droop = rng.uniform(0.03, 0.05), rng.uniform(-0.008, 0.012)
    path = filleted(
        np.array(
            [
                (0, droop, middle + reach),
                (0, 0, middle + 0.3 * reach),
                (0, 0, middle - 0.3 * reach),
                (0, droop, middle - reach),
            ]
        ),
        0.02,
    )
    guard = sweep(path, superellipse(0.01, 0.008, 2.6, 24))
    grip, wide = rng.uniform(0.09, 0.11), rng.uniform(0.016, 0.02)
    turns, s = int(rng.integers(8, 16)), np.linspace(0, 1, 110)
    swell = 0.85 + 0.2 * np.sin(np.pi * s) + 0.04 * np.cos(2 * np.pi * turns * s)
    rings = np.column_stack(
        [-grip * s, middle - wide * swell / 2 * 1.15, middle + wide * swell / 2 * 1.15, wide * swell]
    )
    handle = along_y(rings[::-1], 2.1, 110, 28)
    ball = filleted(np.array([(0.006, 0), (0.013, 0.006), (0.013, 0.014), (0.005, 0.022), (0.0, 0.022)]), 0.005)
    pommel = turned(ball, (0, -grip + 0.004, middle), (0, -1, 0), 40)
    fittings = metal(rng, ["brass", "steel", "copper"])
    return [
        Part(solid, metal(rng, ["steel"])),
        Part(guard + pommel, fittings),
        part(handle, handle_material(rng)),
    ]


def cutter(rng) -> list[Part]:
    """A utility knife: an angled plastic body, a segmented blade, a slider."""
    grip, tall, wide = rng.uniform(0.13, 0.16), rng.uniform(0.02, 0.03), rng.uniform(0.011, 0.016)
    outline = filleted(
        np.array(
            [
                (0, 0),
                (-0.3 * grip, 0.002),
                (-grip, -0.002),
                (-grip, -tall),
                (-0.6 * grip, -tall),
                (-0.3 * grip, -0.85 * tall),
                (-0.006, -0.8 * tall),
            ]
        ),
        [0.003, 0.03, 0.008, 0.008, 0.03, 0.03, 0.003],
        closed=True,
    )
    body = prism(outline, wide, 0.003)
    slot = box((wide, 0.62 * grip, 0.006), (0.75 * wide, -0.4 * grip, -0.3 * tall))
    ridges = [
        rod(
            (wide / 2, -0.62 * grip - 0.005 * k, -tall),
            (wide / 2, -0.62 * grip - 0.005 * k, -0.55 * tall),
            0.0012,
            segments=12,
        )
        for k in range(8)
    ]
    body = cut(body, [slot, *ridges])
    out, high = rng.uniform(0.02, 0.07), 0.6 * tall
    steel = prism(
        np.array(
            [
                (-0.05, -0.75 * tall),
                (out - 0.01, -0.75 * tall),
                (out, -0.75 * tall + high),
                (-0.05, -0.75 * tall + high),
            ]
        ),
        0.0008,
    )
    grooves = [
        box((0.001, 0.0003, high * 1.4), (0.0006, 0, 0)).rotate((-20, 0, 0)).translate((0, at, -0.75 * tall + high / 2))
        for at in np.arange(0.004, out - 0.008, 0.006)
    ]
    steel = cut(steel, grooves)
    slider = prism(
        filleted(
            np.array(
                [
                    (-0.2 * grip, -0.12 * tall),
                    (-0.2 * grip, -0.48 * tall),
                    (-0.34 * grip, -0.48 * tall),
                    (-0.34 * grip, -0.12 * tall),
                ]
            ),
            0.002,
            closed=True,
        ),
        0.006,
        0.0015,
    ).translate((wide / 2 + 0.0005, 0, 0))
    return [
        Part(steel, metal(rng, ["steel"])),
        Part(body, plastic(rng)),
        Part(slider, plastic(rng, ["black-plastic"])),
    ]


def machete(rng) -> list[Part]:
    """A broad forward-heavy blade: machete, kukri or bolo."""
    length, height = rng.uniform(0.24, 0.38), rng.uniform(0.045, 0.07)
    y, t = ends(length)
    bend = rng.uniform(0, 0.9) * height * (1 if rng.uniform() < 0.6 else 0)
    droop = -bend * np.clip(t - 0.25, 0, 1) ** 1.3 * 1.8
    width = height * (0.55 + 0.45 * np.sin(np.pi * np.clip(t * 0.85 + 0.05, 0, 1)) ** 1.5)
    spine = droop - 0.85 * height * np.clip((t - 0.82) / 0.18, 0, 1) ** 2.4
    edge = droop - width + 0.12 * height * np.clip((t - 0.85) / 0.15, 0, 1) ** 2
    solid = blade(y, spine, edge, rng.uniform(0.003, 0.005) * (1 - 0.3 * t), rng.uniform(0.25, 0.5))
    return kitchen_handle(rng, rng.uniform(0.026, 0.03), solid, rng.uniform() < 0.3)


STYLES = (
    chef,
    folder,
    bread,
    hunting,
    cleaver,
    multitool,
    steak,
    combat,
    santoku,
    cutter,
    dagger,
    paring,
    machete,
    table,
)
