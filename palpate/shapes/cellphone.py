"""Cellphones: slabs with camera bumps, home-button phones, candy bars with keypads, flips, sliders, bricks.

Metres; a phone stands upright along z, its screen faces +x, its middle is near the origin.
"""

import numpy as np
from manifold3d import Manifold

from palpate.shapes.assembly import Part
from palpate.shapes.materials import PLASTIC, Material, across, choose, interface, metal
from palpate.shapes.solids import (
    box,
    cut,
    filleted,
    lathe,
    prism,
    rod,
    slab,
    turned,
    union,
)

SHELLS = {
    "graphite": (56, 56, 60),
    "silver": (196, 198, 202),
    "champagne": (212, 190, 156),
    "navy": (36, 54, 96),
    "coral": (220, 104, 88),
    "mint": (160, 208, 186),
    "white": (234, 234, 232),
    "black": (26, 26, 28),
    "red": (176, 28, 36),
}
GLASS = Material("black-glass", (14, 14, 18), 0.0, 0.08)
LENS = Material("lens", (16, 18, 30), 0.2, 0.05)
# Glass and keys stand proud of the shell by so much.
PROUD = 0.0002


def shell(rng) -> Material:
    return choose(rng, SHELLS, rng.choice([0.0, 0.0, 0.6]), rng.uniform(0.25, 0.5))


def disc(x: float, y: float, z: float, radius: float, towards: float, height: float = 0.0006) -> Manifold:
    """A button or lens on the face at x, standing out along x by `height` (towards = 1 front, -1 back)."""
    profile = filleted(np.array([(radius, -0.0015), (radius, height), (0, height)]), min(0.0004, 0.4 * height))
    return turned(profile, (x, y, z), (towards, 0, 0), 40)


def plate(x, y, z, width, height, corner, out=PROUD, deep=0.0012, fillet=0.0002, towards=1) -> Manifold:
    """A rounded plate let into the face at x and standing out by `out`."""
    return slab((deep + out, width, height), corner, fillet, (x + towards * (out - deep) / 2, y, z))


def lit(rng, x, y, z, width, height, old=False) -> Part:
    """A lit screen on the face at x."""
    return Part(plate(x, y, z, width, height, 0.0015, PROUD * 1.5), interface(rng, height / width, old), across)


def side_buttons(rng, thickness, width, height) -> list[Manifold]:
    """Volume and power keys on the rim, and a connector slot's plug-in tongue left out."""
    side = rng.choice([-1, 1])
    keys = [(side, 0.22, 0.011), (-side, 0.3, 0.006), (-side, 0.2, 0.009), (-side, 0.1, 0.009)]
    chosen = keys[: int(rng.integers(2, 5))]
    return [
        slab((0.35 * thickness, 0.003, 2 * half), 0.0012, 0.0004, (0, s * (width / 2 - 0.0009), share * height))
        for s, share, half in chosen
    ]


def holes(thickness: float, height: float) -> list[Manifold]:
    """A connector and speaker holes in the lower edge."""
    z = -height / 2
    tools = [box((0.0026, 0.009, 0.006), (0, 0, z))]
    for y in (*np.arange(0.011, 0.022, 0.0028), *-np.arange(0.011, 0.022, 0.0028)):
        tools.append(rod((0, y, z - 0.002), (0, y, z + 0.002), min(0.0008, 0.2 * thickness), segments=14))
    return tools


def camera_bump(rng, back: float, width: float, height: float) -> tuple[Manifold, list[Manifold]]:
    """The raised island of a modern phone and its lenses: square, pill, bar, disc or single lenses."""
    kind = int(rng.integers(5))
    lens, rise = rng.uniform(0.0042, 0.0068), rng.uniform(0.001, 0.0024)
    top = height / 2
    corner_y, corner_z = -width / 2 + 0.018, top - 0.02
    if kind == 0:
        island = slab((0.003 + rise, 0.029, 0.031), 0.008, 0.0008, (back + (0.003 - rise) / 2, corner_y, corner_z))
        spots = [
            (corner_y - 0.0068, corner_z + 0.007),
            (corner_y - 0.0068, corner_z - 0.007),
            (corner_y + 0.0068, corner_z),
        ]
        spots = spots[: int(rng.integers(2, 4))]
    elif kind == 1:
        island = slab(
            (0.003 + rise, 0.016, 0.045),
            0.0078,
            0.0008,
            (back + (0.003 - rise) / 2, corner_y - 0.004, corner_z - 0.008),
        )
        spots = [(corner_y - 0.004, corner_z - 0.008 + dz) for dz in (0.0138, 0, -0.0138)]
    elif kind == 2:
        island = slab((0.003 + rise, width * 0.94, 0.018), 0.0088, 0.0008, (back + (0.003 - rise) / 2, 0, top - 0.026))
        spots = [(y, top - 0.026) for y in (-0.016, 0.0, 0.013)]
    elif kind == 3:
        middle = (0, top - 0.032)
        profile = filleted(np.array([(0.024, -0.003), (0.024, rise), (0, rise)]), 0.001)
        island = turned(profile, (back, *middle), (-1, 0, 0), 64)
        spots = [(0.0115 * np.cos(a), middle[1] + 0.0115 * np.sin(a)) for a in np.pi / 4 + np.pi / 2 * np.arange(4)]
    else:
        spots = [(corner_y - 0.004, top - 0.014 - 0.016 * k) for k in range(int(rng.integers(2, 4)))]
        island = union([disc(back, y, z, lens + 0.0012, -1, rise) for y, z in spots])
    lenses = [disc(back - rise, y, z, lens, -1, 0.0009) for y, z in spots]
    lenses.append(disc(back - (rise if kind in (0, 2) else 0), spots[0][0] + 0.0125, spots[0][1], 0.0022, -1, 0.0004))
    return island, lenses


def smart(rng) -> list[Part]:
    """A glass slab, edge to edge, with a camera bump and a front camera."""
    width, height, thickness = (
        rng.uniform(0.064, 0.079),
        rng.uniform(0.138, 0.168),
        rng.uniform(0.0068, 0.0098),
    )
    corner = rng.uniform(0.005, 0.013)
    edge = rng.choice([0.001, 0.0025, 0.49 * thickness])
    front, back = thickness / 2, -thickness / 2
    body = cut(slab((thickness, width, height), corner, edge), holes(thickness, height))
    rim = max(0.0022, 0.75 * edge)
    screen = plate(front, 0, 0, width - 2 * rim, height - 2 * rim, max(corner - rim, 0.002))
    island, lenses = camera_bump(rng, back, width, height)
    look = shell(rng)
    border = rng.uniform(0.0012, 0.0025)
    picture = lit(rng, front, 0, 0, width - 2 * rim - 2 * border, height - 2 * rim - 2 * border)
    notch = disc(front + PROUD * 1.5, rng.choice([0, -0.02]), height / 2 - rim - 0.005, 0.002, 1, 0.0002)
    body = union([body, *side_buttons(rng, thickness, width, height)])
    two_tone = rng.uniform() < 0.4
    parts = [Part(body if two_tone else body + island, look)]
    if two_tone:
        parts.append(Part(island, Material("island", tuple(c // 2 for c in look.colour), 0.3, 0.3)))
    return [*parts, Part(screen, GLASS), picture, Part(union([notch, *lenses]), LENS)]


def tablet_like(rng) -> list[Part]:
    """A phone of the first touch years: bezels, a home button, an earpiece, a rounded back."""
    width, height, thickness = rng.uniform(0.058, 0.07), rng.uniform(0.112, 0.14), rng.uniform(0.008, 0.0125)
    front, back = thickness / 2, -thickness / 2
    body = cut(
        slab((thickness, width, height), rng.uniform(0.007, 0.014), rng.uniform(0.3, 0.49) * thickness),
        holes(thickness, height),
    )
    bezel = rng.uniform(0.013, 0.019)
    face = plate(front, 0, 0, width - 0.008, height - 0.008, 0.006)
    screen = lit(rng, front + PROUD, 0, 0, width - 0.0125, height - 2 * bezel)
    low, high = -height / 2 + 0.5 * bezel + 0.002, height / 2 - 0.5 * bezel - 0.001
    if rng.uniform() < 0.6:
        button = disc(front + PROUD, 0, low, 0.0052, 1, 0.0004) - disc(
            front + PROUD + 0.0005, 0, low, 0.0042, 1, 0.0002
        )
    else:
        button = union([plate(front + PROUD, y, low, 0.011, 0.0045, 0.002, 0.0005) for y in (-0.015, 0, 0.015)])
    ear = plate(front + PROUD, 0, high, 0.012, 0.0018, 0.0008, 0.0002)
    look = shell(rng)
    camera = union(
        [
            disc(back, -width / 2 + 0.014, height / 2 - 0.014, 0.0045, -1, 0.0008),
            disc(back, -width / 2 + 0.026, height / 2 - 0.014, 0.002, -1, 0.0004),
        ]
    )
    dark = rng.uniform() < 0.7
    parts = [
        Part(union([body, *side_buttons(rng, thickness, width, height)]), look),
        Part(face, GLASS if dark else Material("white-glass", (236, 236, 236), 0, 0.1)),
        screen,
    ]
    return [*parts, Part(button + ear, metal(rng, ["steel", "aluminium"])), Part(camera, LENS)]


def keypad(rng, front, z_low, z_high, width, rows=4, columns=3, gap=0.0012, round_keys=False, out=0.0009) -> Manifold:
    """Keys in a grid between two heights."""
    pitch_y, pitch_z = width / columns, (z_high - z_low) / rows
    keys = []
    for row in range(rows):
        for column in range(columns):
            y, z = -width / 2 + (column + 0.5) * pitch_y, z_low + (row + 0.5) * pitch_z
            wide, tall = pitch_y - gap, pitch_z - gap
            if round_keys:
                wide = tall = min(wide, tall)
            keys.append(plate(front, y, z, wide, tall, 0.49 * tall if round_keys else 0.3 * tall, out, 0.001, 0.0004))
    return union(keys)


def navigation(rng, front, z, width, out=0.001) -> tuple[Manifold, Manifold]:
    """A direction pad with its middle key, and soft keys beside it."""
    radius = rng.uniform(0.15, 0.2) * width
    if rng.uniform() < 0.5:
        pad = disc(front, 0, z, radius, 1, out) - disc(front + 0.4 * out + 0.0012, 0, z, 0.62 * radius, 1, out)
        middle = disc(front, 0, z, 0.5 * radius, 1, out)
    else:
        pad = plate(front, 0, z, 2.2 * radius, 1.7 * radius, 0.4 * radius, out) - plate(
            front + 2 * out, 0, z, 1.3 * radius, 0.9 * radius, 0.2 * radius, out, 0.0022
        )
        middle = plate(front, 0, z, 1.1 * radius, 0.7 * radius, 0.2 * radius, out)
    keys = [
        plate(front, side * 0.36 * width, z + dz, 0.2 * width, 0.5 * radius, 0.2 * radius, 0.8 * out)
        for side in (-1, 1)
        for dz in (0.45 * radius, -0.45 * radius)
    ]
    return pad, union([middle, *keys])


def earpiece(front, z, width=0.012, slots=3) -> list[Manifold]:
    """Slots over the loudspeaker, as tools to cut."""
    return [plate(front, 0, z - 0.0018 * k, width, 0.0008, 0.0003, 0.001, 0.0008) for k in range(slots)]


def candy_bar(rng) -> list[Part]:
    """A keypad phone: small screen, direction pad, twelve keys; sometimes with a stub antenna."""
    width, height, thickness = rng.uniform(0.042, 0.05), rng.uniform(0.1, 0.125), rng.uniform(0.012, 0.021)
    front = thickness / 2
    waist = rng.uniform(0, 0.06)

    def taper(vertices):
        factor = 1 - waist * (1 - (2 * vertices[:, 2] / height) ** 2)
        return vertices * np.column_stack([np.ones(len(vertices)), factor, np.ones(len(vertices))])

    body = slab((thickness, width, height), rng.uniform(0.006, 0.02), rng.uniform(0.2, 0.45) * thickness)
    body = cut(body, [*earpiece(front, height * 0.46), *holes(thickness, height)])
    inner = width * 0.8
    screen_height = rng.uniform(0.27, 0.36) * height
    screen_z = 0.4 * height - screen_height / 2
    bezel = plate(front, 0, screen_z, inner, screen_height + 0.006, 0.004, PROUD)
    screen = lit(rng, front + PROUD, 0, screen_z, inner - 0.006, screen_height - 0.002, old=True)
    pad_z = screen_z - screen_height / 2 - 0.0145
    pad, soft = navigation(rng, front, pad_z, inner)
    keys = keypad(rng, front, -0.455 * height, pad_z - 0.0115, inner, round_keys=rng.uniform() < 0.3)
    if rng.uniform() < 0.35:
        x, y = -0.1 * thickness, width / 2 - 0.009
        stub = filleted(np.array([(0.0045, 0), (0.004, rng.uniform(0.014, 0.028)), (0, 0.03)])[:2], 0)
        body += lathe(filleted(np.append(stub, [[0, stub[-1, 1]]], axis=0), 0.002), 32).translate(
            (x, y, height / 2 - 0.005)
        )
    body = body.warp_batch(taper)
    look, key_look = shell(rng), choose(rng, SHELLS, 0, 0.4, ["white", "silver", "black", "graphite"])
    camera = disc(-front, 0, 0.36 * height, 0.004, -1, 0.0006)
    return [
        Part(body, look),
        Part(bezel, GLASS),
        screen,
        Part(union([keys, soft]), Material("keys", key_look.colour, 0, 0.4)),
        Part(pad, metal(rng, ["aluminium", "steel"])),
        Part(camera, LENS),
    ]


def qwerty(rng) -> list[Part]:
    """A business phone: wide screen over a full keyboard."""
    width, height, thickness = rng.uniform(0.06, 0.07), rng.uniform(0.107, 0.125), rng.uniform(0.011, 0.0155)
    front = thickness / 2
    body = cut(
        slab((thickness, width, height), rng.uniform(0.008, 0.016), rng.uniform(0.25, 0.45) * thickness),
        [*earpiece(front, height * 0.45), *holes(thickness, height)],
    )
    screen_height = 0.38 * height
    screen_z = 0.42 * height - screen_height / 2
    bezel = plate(front, 0, screen_z, 0.84 * width, screen_height + 0.005, 0.003)
    screen = lit(rng, front + PROUD, 0, screen_z, 0.76 * width, screen_height, old=rng.uniform() < 0.5)
    z = screen_z - screen_height / 2 - 0.0085
    ball = disc(front, 0, z, 0.0042, 1, 0.0018)
    buttons = union([plate(front, y, z, 0.011, 0.006, 0.002, 0.0007) for y in (-0.021, -0.0085, 0.0085, 0.021)])
    keys = keypad(rng, front, -0.46 * height, z - 0.0065, 0.86 * width, 4, 10, 0.0009, out=0.0008)
    look = shell(rng)
    dark = choose(rng, SHELLS, 0, 0.4, ["black", "graphite", "white"])
    rails = slab((0.3 * thickness, width + 0.0012, height * 0.8), 0.01, 0.0005)
    return [
        Part(body, look),
        Part(rails, metal(rng, ["aluminium", "steel"])),
        Part(bezel, GLASS),
        screen,
        Part(union([keys, buttons]), Material("keys", dark.colour, 0, 0.35)),
        Part(ball, metal(rng, ["aluminium"])),
    ]


def hinge(width: float, radius: float, z: float, x: float = 0.0) -> Manifold:
    """Knuckles across the phone's width."""
    pins = []
    for low, high in ((-0.48, -0.3), (-0.28, 0.28), (0.3, 0.48)):
        profile = filleted(np.array([(radius, 0), (radius, (high - low) * width), (0, (high - low) * width)]), 0.0006)
        pins.append(turned(profile, (x, low * width, z), (0, 1, 0), 36))
    pins.append(rod((x, -0.45 * width, z), (x, 0.45 * width, z), 0.75 * radius))
    return union(pins)


def flip(rng) -> list[Part]:
    """A clamshell, open by 140 to 175 degrees or closed."""
    width, half = rng.uniform(0.044, 0.052), rng.uniform(0.08, 0.095)
    lower, upper = rng.uniform(0.01, 0.014), rng.uniform(0.007, 0.01)
    corner = rng.uniform(0.006, 0.02)
    is_open = rng.uniform() < 0.75
    opening = rng.uniform(140, 175) if is_open else 0.0
    base_face, lid_face = lower / 2, upper / 2
    base = cut(slab((lower, width, half), corner, 0.3 * lower), holes(lower, half))
    lid = cut(slab((upper, width, half), corner, 0.3 * upper), earpiece(lid_face, 0.45 * half))
    pad, soft = navigation(rng, base_face, 0.3 * half, 0.84 * width, 0.0005)
    keys = keypad(rng, base_face, -0.45 * half, 0.3 * half - 0.0105, 0.84 * width, out=0.0005)
    glass = plate(lid_face, 0, 0.02 * half, 0.82 * width, 0.78 * half, 0.003)
    picture = lit(rng, lid_face + PROUD, 0, 0.02 * half, 0.68 * width, 0.66 * half, old=True)
    window = plate(-lid_face, 0, 0.18 * half, 0.55 * width, 0.3 * half, 0.003, 0.0003, towards=-1)
    camera = disc(-lid_face, 0, 0.4 * half, 0.0035, -1, 0.0008)
    # Base below the hinge, lid turned about it; at 180 degrees both faces lie in one plane.
    gap = 0.0012
    drop = np.array([-lower / 2 - gap / 2, 0, -half / 2 - 0.001])
    rise = np.array([-upper / 2 - gap / 2, 0, half / 2 + 0.001])

    def base_place(solid):
        return solid.translate(drop)

    def lid_place(solid):
        return solid.translate(rise).rotate((0, 180 - opening, 0))

    look = shell(rng)
    lid_look = look if rng.uniform() < 0.5 else Material("lid", shell(rng).colour, 0.3, 0.3)
    key_look = choose(rng, SHELLS, 0, 0.4, ["white", "silver", "black", "graphite"])
    parts = [
        (Part(base, look), base_place),
        (
            Part(
                hinge(width, 0.35 * (lower + upper) / 2 + gap, 0),
                Material("hinge", tuple(int(c * 0.8) for c in look.colour), 0.3, 0.4),
            ),
            lambda s: s,
        ),
        (Part(lid, lid_look), lid_place),
        (Part(pad, metal(rng, ["aluminium", "steel"])), base_place),
        (Part(union([keys, soft]), Material("keys", key_look.colour, 0, 0.4)), base_place),
        (Part(glass, GLASS), lid_place),
        (Part(window, Material("window", (30, 34, 44), 0, 0.08)), lid_place),
        (Part(camera, LENS), lid_place),
    ]
    parts = [Part(place(p.solid), p.material) for p, place in parts]
    return [*parts, Part(lid_place(picture.solid), picture.material, along_plate)]


def along_plate(vertices: np.ndarray) -> np.ndarray:
    """Texture coordinates over a plate that is tilted about y: width along y, height along its long axis."""
    centred = vertices - vertices.mean(axis=0)
    axis = np.linalg.svd(centred[:, [0, 2]], full_matrices=False)[2][0]
    axis *= np.sign(axis[1]) or 1.0
    flat = np.stack([vertices[:, 1], centred[:, [0, 2]] @ axis], axis=1)
    low, high = flat.min(axis=0), flat.max(axis=0)
    return (flat - low) / np.maximum(high - low, 1e-9)


def slider(rng) -> list[Part]:
    """Two slabs, the front one slid up from the keypad."""
    width, half = rng.uniform(0.045, 0.055), rng.uniform(0.092, 0.108)
    lower, upper = rng.uniform(0.007, 0.01), rng.uniform(0.006, 0.008)
    corner = rng.uniform(0.005, 0.012)
    slide = rng.uniform(0.36, 0.46) * half
    base = cut(
        slab((lower, width, half), corner, 0.3 * lower, (-upper / 2, 0, -slide / 2)),
        [h.translate((-upper / 2, 0, -slide / 2)) for h in holes(lower, half)],
    )
    front, top = lower / 2 + upper / 2, slide / 2
    lid = cut(
        slab((upper, width, half), corner, 0.3 * upper, (lower / 2, 0, top)),
        earpiece(front, top + 0.45 * half),
    )
    base_face = lower / 2 - upper / 2
    keys = keypad(
        rng,
        base_face,
        -slide / 2 - 0.47 * half,
        -slide / 2 - 0.47 * half + slide * 0.9,
        0.86 * width,
        out=0.0005,
    )
    glass = plate(front, 0, top + 0.09 * half, 0.86 * width, 0.7 * half, 0.003)
    picture = lit(rng, front + PROUD, 0, top + 0.09 * half, 0.74 * width, 0.6 * half, old=rng.uniform() < 0.5)
    pad, soft = navigation(rng, front, top - 0.37 * half, 0.84 * width, 0.0007)
    rail = box((0.0012, 0.7 * width, half * 0.9), (base_face + 0.0002, 0, 0))
    look = shell(rng)
    key_look = choose(rng, SHELLS, 0, 0.4, ["white", "silver", "black", "graphite"])
    return [
        Part(lid, look),
        Part(base + rail, Material("base", shell(rng).colour, 0.2, 0.4)),
        Part(glass, GLASS),
        picture,
        Part(union([keys, soft]), Material("keys", key_look.colour, 0, 0.4)),
        Part(pad, metal(rng, ["aluminium", "steel"])),
    ]


def brick(rng) -> list[Part]:
    """The first portable phones: thick, long, a rod antenna, a window over many keys."""
    width, height, thickness = rng.uniform(0.046, 0.058), rng.uniform(0.15, 0.2), rng.uniform(0.03, 0.042)
    side = filleted(
        np.array([(-0.5, -0.5), (0.36, -0.5), (0.5, -0.36), (0.42, 0.3), (0.5, 0.42), (0.42, 0.5), (-0.5, 0.5)])
        * [thickness, height],
        [0.005, 0.01, 0.02, 0.03, 0.008, 0.006, 0.006],
        closed=True,
    )
    # The profile is drawn in x-z; a prism stands in y-z: turn it about z.
    body = prism(side, width, 0.004).rotate((0, 0, -90))
    front = 0.44 * thickness
    grille = [
        plate(front + 0.002, 0, 0.4 * height - 0.0035 * k, 0.5 * width, 0.0014, 0.0005, 0.004, 0.004) for k in range(5)
    ]
    body = cut(body, grille)
    keys = keypad(rng, front, -0.36 * height, 0.06 * height, 0.78 * width, 5, 3, 0.0022, out=0.002)
    bed = plate(front - 0.001, 0, -0.15 * height, 0.84 * width, 0.47 * height, 0.003, 0.0016, 0.012)
    window = plate(front - 0.002, 0, 0.2 * height, 0.7 * width, 0.09 * height, 0.002, 0.002, 0.01)
    digits = lit(rng, front, 0, 0.2 * height, 0.6 * width, 0.065 * height, old=True)
    y, x = 0.3 * width, -0.28 * thickness
    length = rng.uniform(0.05, 0.12)
    antenna = [(0.007, -0.005), (0.006, 0.02), (0.0042, 0.026), (0.0038, length), (0, length)]
    rod_antenna = lathe(filleted(np.array(antenna), 0.0015), 32).translate((x, y, height / 2))
    look = choose(
        rng,
        {**SHELLS, "putty": (186, 176, 152), "olive": (88, 92, 62)},
        0,
        0.55,
        ["putty", "graphite", "black", "olive", "white"],
    )
    rubber = Material("rubber", (30, 30, 32), 0, 0.8)
    return [
        Part(body, look),
        Part(rod_antenna, rubber),
        Part(bed, Material("bed", (58, 58, 60), 0, 0.6)),
        Part(window, GLASS),
        digits,
        Part(keys, choose(rng, PLASTIC, 0, 0.4, ["white-plastic", "teal-plastic", "yellow-plastic"])),
    ]


def rugged(rng) -> list[Part]:
    """A slab in a bumper: thick corners, ridges, screws, a lanyard eye."""
    width, height, thickness = rng.uniform(0.07, 0.08), rng.uniform(0.14, 0.165), rng.uniform(0.012, 0.016)
    front = thickness / 2
    body = slab((thickness, width, height), 0.008, 0.0025)
    rims = []
    for sy in (-1, 1):
        for sz in (-1, 1):
            rims.append(
                slab(
                    (thickness + 0.003, 0.026, 0.034),
                    0.009,
                    0.002,
                    (0, sy * (width / 2 - 0.01), sz * (height / 2 - 0.014)),
                )
            )
    ribs = [
        box((thickness * 0.8, 0.003, 0.0025), (0, sy * width / 2, z))
        for sy in (-1, 1)
        for z in np.arange(-0.25, 0.26, 0.05) * height
    ]
    well = box((0.01, width - 0.012, height - 0.016), (front + 0.005, 0, 0))
    bumper = cut(union([*rims, *ribs]), [well, slab((thickness - 0.002, width - 0.006, height - 0.006), 0.006, 0.001)])
    eye = np.array([(0, 0.008), (0.008, 0.006), (0.008, -0.006), (0, -0.008)])
    lug = prism(filleted(np.column_stack([eye[:, 1], eye[:, 0]]), 0.003, closed=True), 0.006, 0.001).translate(
        (0, -0.3 * width, height / 2 - 0.001)
    )
    lug -= rod(
        (-0.01, -0.3 * width, height / 2 + 0.003),
        (0.01, -0.3 * width, height / 2 + 0.003),
        0.002,
        segments=24,
    )
    glass = plate(front, 0, 0, width - 0.014, height - 0.018, 0.003)
    picture = lit(rng, front + PROUD, 0, 0.004, width - 0.02, height - 0.04)
    bar = union([plate(front + PROUD, y, -height / 2 + 0.015, 0.012, 0.005, 0.002, 0.0008) for y in (-0.016, 0, 0.016)])
    screws = union(
        [disc(-front, sy * 0.4 * width, sz * 0.25 * height, 0.0028, -1, 0.0005) for sy in (-1, 1) for sz in (-1, 1)]
    )
    island, lenses = camera_bump(rng, -front, width - 0.012, height - 0.03)
    return [
        Part(body + island, shell(rng)),
        Part(
            bumper + lug,
            choose(rng, PLASTIC, 0, 0.7, ["yellow-plastic", "orange-plastic", "black-plastic", "red-plastic"]),
        ),
        Part(glass, GLASS),
        picture,
        Part(union([bar, screws]), metal(rng, ["steel"])),
        Part(union(lenses), LENS),
    ]


def swivel(rng) -> list[Part]:
    """A screen turned out sideways over a keypad, or a banana-curved bar."""
    width, height, thickness = rng.uniform(0.045, 0.052), rng.uniform(0.095, 0.11), rng.uniform(0.009, 0.012)
    corner = 0.49 * width if rng.uniform() < 0.5 else 0.012
    base = cut(slab((thickness, width, height), corner, 0.3 * thickness), holes(thickness, height))
    keys = keypad(rng, thickness / 2, -0.42 * height, 0.08 * height, 0.72 * width, out=0.0005)
    upper = 0.007
    x = thickness / 2 + upper / 2 + 0.0006
    angle = rng.choice([0.0, 30.0, 60.0, 90.0])
    lid = slab((upper, width, 0.9 * height), corner, 0.3 * upper)
    glass = plate(upper / 2, 0, 0, 0.78 * width, 0.66 * height, 0.003)
    picture = lit(rng, upper / 2 + PROUD, 0, 0, 0.68 * width, 0.57 * height, old=True)
    pivot = np.array([0, 0, 0.28 * height])

    def turn(solid):
        return solid.translate(-pivot).rotate((angle, 0, 0)).translate(pivot + [x, 0, 0])

    pin = rod((0, 0, 0.28 * height), (x, 0, 0.28 * height), 0.01)
    low = turn(picture.solid)

    def uv(vertices):
        # Turned back, the picture lies upright.
        a = np.radians(-angle)
        flat = (vertices - pivot)[:, 1:] @ np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]])
        return (flat - flat.min(axis=0)) / np.ptp(flat, axis=0)

    look = shell(rng)
    return [
        Part(union([base, pin]), look),
        Part(turn(lid), Material("lid", shell(rng).colour, 0.3, 0.3)),
        Part(turn(glass), GLASS),
        Part(low, picture.material, uv),
        Part(keys, choose(rng, PLASTIC, 0, 0.4, ["white-plastic", "black-plastic"])),
    ]


STYLES = (smart, candy_bar, flip, tablet_like, qwerty, slider, smart, brick, rugged, swivel)
