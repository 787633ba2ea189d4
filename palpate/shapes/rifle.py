"""Rifles: stock, receiver, barrel, magazine, sights or scope, in the layouts of many makes.

Metres; the bore lies along y at z = 0, the muzzle towards +y; the receiver's back is near y = 0, the stock at
y < 0; up is +z.
"""

import numpy as np
from manifold3d import Manifold

from palpate.shapes.assembly import Part
from palpate.shapes.materials import POLYMER, Material, across, choose, dark_metal, metal, polymer, wood
from palpate.shapes.solids import along_y, box, cut, filleted, prism, rod, superellipse, sweep, turned, union

OPTIC = Material("optic", (24, 24, 28), 0.4, 0.35)
GLASS = Material("optic-glass", (60, 90, 140), 0.3, 0.05)


def part(solid: Manifold, material: Material) -> Part:
    """A part whose picture, if it has one, lies across its side."""
    return Part(solid, material, across if material.picture else None)


def furniture(rng, wooden: float) -> Material:
    """Material of stocks and grips: wood with the probability `wooden`, else polymer."""
    return wood(rng) if rng.uniform() < wooden else polymer(rng)


def plank(points, radii, thickness: float, edge: float) -> Manifold:
    """A plate in y-z from corner points with fillets, its rim rounded."""
    return prism(filleted(np.array(points), radii, closed=True), thickness, edge)


def barrel(start: float, end: float, thick: float, thin: float, steps: int = 0) -> Manifold:
    """A tapering barrel with a bore at the muzzle; `steps` adds shoulders."""
    length = end - start
    profile = [(thick, 0.0), (thick, 0.1 * length), (thick - 0.3 * (thick - thin), 0.22 * length)]
    for k in range(steps):
        at, radius = (0.35 + 0.2 * k) * length, thick - (thick - thin) * (0.4 + 0.3 * k)
        profile += [(radius + 0.0015, at), (radius + 0.0015, at + 0.02), (radius, at + 0.021)]
    profile += [(thin, length), (0.0, length)]
    solid = turned(np.array(profile), (0, start, 0), (0, 1, 0), 36)
    return solid - rod((0, end - 0.03, 0), (0, end + 0.01, 0), 0.0035, segments=20)


def muzzle(rng, end: float, radius: float, kind: int | None = None) -> Manifold:
    """At the end of a barrel: a flash hider, a brake with ports, a suppressor, or just a crown.

    Its own bore is wider than the barrel's, so that no wall of one lies in a wall of the other.
    """
    kind = int(rng.integers(4)) if kind is None else kind
    tools = [rod((0, end - 0.05, 0), (0, end + 0.3, 0), 0.0047, segments=20)]
    if kind == 0:
        profile = [(radius + 0.003, 0), (radius + 0.004, 0.045), (0.005, 0.045)]
        body = turned(filleted(np.array(profile), 0.001), (0, end - 0.006, 0), (0, 1, 0))
        tools += [box((0.002, 0.028, 0.03), (0, end + 0.016, 0)).rotate((0, a, 0)) for a in (0, 60, 120)]
    elif kind == 1:
        tall, wide = radius + 0.005, 2 * radius + 0.013
        body = along_y([(end - 0.008, -tall, tall, wide), (end + 0.055, -tall, tall, wide)], 4, 6, 32)
        tools += [box((0.06, 0.008, 1.3 * radius), (0, end + at, 0)) for at in (0.012, 0.028, 0.044)]
    elif kind == 2:
        length, wide = rng.uniform(0.13, 0.2), rng.uniform(0.017, 0.022)
        profile = [(wide * 0.8, 0), (wide, 0.008), (wide, length), (0.006, length)]
        body = turned(filleted(np.array(profile), 0.002), (0, end - 0.03, 0), (0, 1, 0), 40)
    else:
        profile = [(radius + 0.0015, 0), (radius + 0.0015, 0.016), (0.005, 0.016)]
        body = turned(filleted(np.array(profile), 0.001), (0, end - 0.014, 0), (0, 1, 0))
    return cut(body, tools)


def rail(start: float, end: float, z: float, width: float = 0.021) -> Manifold:
    """A toothed accessory rail along the top, from z upwards."""
    count = max(2, int((end - start) / 0.0105))
    tooth = np.array([(0, 0.0045), (0, 0.0085), (0.0052, 0.0085), (0.0052, 0.0045)])
    top = np.concatenate([tooth + [start + k * (end - start) / count, z] for k in range(count)])
    outline = np.concatenate(
        [
            [(start - 0.001, z - 0.003)],
            top + [0.0, 0.0],
            [(end + 0.001, z + 0.0045), (end + 0.001, z - 0.003)],
        ]
    )
    return prism(outline, width)


def scope(rng, y: float, z: float, length: float | None = None) -> list[Part]:
    """A telescopic sight with turrets and rings, its axis at height z above mounts at `z - 0.03`."""
    length = rng.uniform(0.24, 0.36) if length is None else length
    tube, eye, front = 0.0135, rng.uniform(0.019, 0.022), rng.uniform(0.018, 0.029)
    half = length / 2
    profile = [
        (eye - 0.002, -half),
        (eye, -half + 0.004),
        (eye, -half + 0.05),
        (tube, -half + 0.075),
        (tube, half - 0.1),
        (front, half - 0.06),
        (front, half),
    ]
    body = turned(filleted(np.array(profile), 0.008), (0, y, z), (0, 1, 0), 36)
    turret = filleted(np.array([(0.0115, 0), (0.0115, 0.026), (0, 0.026)]), 0.002)
    turrets = [
        turned(turret, (0, y - 0.01, z), (0, 0, 1), 24),
        turned(turret, (0, y - 0.01, z), (1, 0, 0), 24),
    ]
    if rng.uniform() < 0.5:
        turrets.append(turned(turret, (0, y - 0.01, z), (-1, 0, 0), 24))
    cups = [
        rod((0, y + s * (half - 0.006), z), (0, y + s * (half + 0.01), z), r - 0.003, segments=24)
        for s, r in ((1, front), (-1, eye))
    ]
    mounts = []
    for at in (-0.25 * length + 0.005, 0.2 * length):
        ring = turned(np.array([(tube + 0.0035, -0.009), (tube + 0.0035, 0.009)]), (0, y + at, z), (0, 1, 0), 28)
        mounts += [ring, box((0.016, 0.018, 0.034), (0, y + at, z - 0.02))]
    glass = union(
        [
            rod((0, y + s * (half - 0.02), z), (0, y + s * (half - 0.004), z), r - 0.0028, segments=24)
            for s, r in ((1, front), (-1, eye))
        ]
    )
    return [Part(union([cut(body, cups), *turrets, *mounts]), OPTIC), Part(glass, GLASS)]


def red_dot(y: float, z: float, tall: bool) -> list[Part]:
    """A holographic box sight, or a short tube, on a rail whose top is at z."""
    if tall:
        frame = plank(
            [
                (y - 0.045, z - 0.004),
                (y - 0.045, z + 0.018),
                (y - 0.01, z + 0.026),
                (y - 0.006, z + 0.05),
                (y + 0.035, z + 0.05),
                (y + 0.045, z + 0.02),
                (y + 0.045, z - 0.004),
            ],
            0.003,
            0.03,
            0.003,
        )
        frame = cut(frame, [box((0.024, 0.12, 0.026), (0, y, z + 0.034))])
        return [Part(frame, OPTIC), Part(box((0.0245, 0.002, 0.027), (0, y + 0.028, z + 0.034)), GLASS)]
    body = turned(filleted(np.array([(0.017, -0.035), (0.017, 0.035)]), 0.002), (0, y, z + 0.032), (0, 1, 0), 40)
    body = body - rod((0, y - 0.05, z + 0.032), (0, y + 0.05, z + 0.032), 0.0145, segments=32)
    base = box((0.02, 0.05, 0.024), (0, y, z + 0.007)) + turned(
        np.array([(0.007, 0), (0.007, 0.022)]), (0, y + 0.01, z + 0.034), (1, 0, 0), 24
    )
    return [
        Part(body + base, OPTIC),
        Part(rod((0, y + 0.02, z + 0.032), (0, y + 0.023, z + 0.032), 0.0148, segments=32), GLASS),
    ]


def post(y: float, low: float, high: float, ears: bool = True) -> Manifold:
    """A front sight: a block with a post, between ears."""
    block = plank(
        [(y - 0.016, low), (y - 0.005, high - 0.012), (y + 0.006, high - 0.012), (y + 0.012, low)],
        0.002,
        0.012,
        0.001,
    )
    pin = rod((0, y, high - 0.015), (0, y, high), 0.0014, segments=12)
    if not ears:
        return block + pin
    sides = [
        plank(
            [
                (y - 0.007, high - 0.016),
                (y - 0.004, high + 0.002),
                (y + 0.005, high + 0.002),
                (y + 0.008, high - 0.016),
            ],
            0.002,
            0.0022,
            0.0005,
        ).translate((x, 0, 0))
        for x in (-0.0049, 0.0049)
    ]
    return union([block, pin, *sides])


def trigger(y: float, z: float, length: float = 0.06, drop: float = 0.032) -> Manifold:
    """A trigger and its guard below a receiver's underside z; the guard spans y - length .. y."""
    path = filleted(
        np.array(
            [
                (0, y, z + 0.006),
                (0, y - 0.004, z - drop),
                (0, y - length + 0.004, z - drop),
                (0, y - length, z + 0.006),
            ]
        ),
        0.014,
    )
    guard = sweep(path, superellipse(0.011, 0.003, 4, 20))
    bent = filleted(
        np.array(
            [
                (0, y - 0.5 * length, z + 0.006),
                (0, y - 0.56 * length, z - 0.45 * drop),
                (0, y - 0.46 * length, z - 0.8 * drop),
            ]
        ),
        0.03,
    )
    return guard + sweep(bent, superellipse(0.006, 0.004, 3, 16))


def pistol_grip(rng, y: float, z: float, length: float | None = None) -> Manifold:
    """A raked grip below (y, z)."""
    length = rng.uniform(0.085, 0.105) if length is None else length
    rake = rng.uniform(0.3, 0.5) * length
    path = filleted(
        np.array([(0, y, z + 0.012), (0, y - 0.3 * rake, z - 0.3 * length), (0, y - rake, z - length)]), 0.08
    )
    scale = np.linspace(1, 0, len(path))[:, None] * [-0.04, 0.12] + [1, 1.0]
    return sweep(path, superellipse(0.03, 0.044, 2.8, 36), scale)


def box_magazine(
    rng, y: float, z: float, curve: float, length: float, width: float = 0.022, depth: float = 0.06
) -> Manifold:
    """A ribbed magazine below (y, z): straight, or bent forwards by `curve` radians over its length."""
    s = np.linspace(0, 1, 14)
    if curve > 0:
        radius = length / curve
        path = np.column_stack([0 * s, y + radius * (1 - np.cos(curve * s)), z + 0.015 - radius * np.sin(curve * s)])
    else:
        path = np.column_stack([0 * s, y + 0.05 * length * s, z + 0.015 - length * s])
    body = sweep(path, superellipse(width, depth, 7, 32))
    groove = sweep(path[3:12], superellipse(0.004, 0.1 * depth, 2, 12))
    sides = [
        groove.translate((side * width / 2, shift, 0)) for side in (-1, 1) for shift in (-0.18 * depth, 0.12 * depth)
    ]
    foot_at, foot_dir = path[-1], path[-1] - path[-2]
    foot_dir = foot_dir / np.linalg.norm(foot_dir)
    foot = sweep(
        [foot_at - 0.004 * foot_dir, foot_at + 0.006 * foot_dir],
        superellipse(width + 0.005, depth + 0.006, 6, 32),
    )
    return cut(body, sides) + foot


def bipod(rng, y: float, z: float) -> Manifold:
    """Two legs, spread or folded forwards."""
    length = rng.uniform(0.18, 0.24)
    legs = [box((0.04, 0.03, 0.02), (0, y, z - 0.004))]
    folded = rng.uniform() < 0.4
    for side in (-1, 1):
        hip = np.array([side * 0.016, y, z - 0.008])
        foot = hip + (
            np.array([side * 0.02, length, -0.006])
            if folded
            else np.array([side * 0.4 * length, 0.2 * length, -0.85 * length])
        )
        knee = hip + 0.55 * (foot - hip)
        legs += [
            rod(hip, knee, 0.0075, segments=20),
            rod(knee - 0.02 * (foot - hip), foot, 0.005, segments=20),
            Manifold.sphere(0.009, 20).translate(foot),
        ]
    return union(legs)


def bolt_handle(y: float, z: float) -> Manifold:
    """A turned-down bolt handle with a knob, on the right (-x) side."""
    path = filleted(np.array([(0, y, z), (-0.03, y - 0.004, z - 0.004), (-0.05, y - 0.02, z - 0.03)]), 0.015)
    return sweep(path, superellipse(0.009, 0.009, 2, 20), side=(0, 1, 0)) + Manifold.sphere(0.0095, 28).translate(
        (-0.052, y - 0.021, z - 0.033)
    )


def hunting_stock(rng, grip_y: float, fore_end: float, comb: float, cheek: bool) -> Manifold:
    """A one-piece stock: butt, wrist, belly, fore-end; the barrel channel lies at its top (z = 0)."""
    butt = grip_y - rng.uniform(0.3, 0.34)
    drop = rng.uniform(0.012, 0.03)
    toe = -drop - rng.uniform(0.115, 0.13)
    stations = [
        (butt, toe + 0.006, -drop - 0.004, 0.034),
        (butt + 0.012, toe, -drop, 0.041),
        (butt + 0.12, 0.64 * toe - 0.004, -0.8 * drop + comb, 0.042),
        (grip_y - 0.055, -0.094, -0.02 + comb * 0.3, 0.038),
        (grip_y, -0.066, -0.022, 0.036),
        (grip_y + 0.05, -0.047, -0.004, 0.044),
        (grip_y + 0.17, -0.046, 0.0, 0.05),
        (0.55 * fore_end, -0.042, 0.001, 0.048),
        (fore_end - 0.02, -0.034, 0.0, 0.038),
        (fore_end, -0.026, -0.006, 0.024),
    ]
    body = along_y(stations, rng.uniform(2.3, 3.2), 70, 36)
    if cheek:
        rest = along_y(
            [
                (butt + 0.06, -0.05, 0.01 + comb, 0.01),
                (butt + 0.1, -0.05, 0.014 + comb, 0.03),
                (butt + 0.2, -0.05, 0.014 + comb, 0.03),
                (butt + 0.235, -0.05, 0.0 + comb, 0.01),
            ],
            2.4,
            24,
            28,
        )
        body += rest.translate((0, 0, -0.004))
    return body


def butt_pad(stock: Manifold, thickness: float = 0.018) -> Manifold:
    """A rubber pad that continues a stock's butt backwards."""
    butt = stock.bounding_box()[1]
    end = stock.trim_by_plane((0, -1, 0), -(butt + 0.03)).bounding_box()
    middle, tall = (end[2] + end[5]) / 2, end[5] - end[2]
    stations = [
        (butt - thickness, middle - 0.47 * tall, middle + 0.47 * tall, 0.03),
        (butt - thickness + 0.006, middle - 0.51 * tall, middle + 0.51 * tall, 0.043),
        (butt + 0.008, middle - 0.5 * tall, middle + 0.5 * tall, 0.0425),
    ]
    return along_y(stations, 2.8, 14, 36)


def bolt_action(rng) -> list[Part]:
    """A hunting rifle: one-piece stock, round receiver, turned-down bolt, mostly with a scope."""
    length = rng.uniform(0.5, 0.66)
    heavy = rng.uniform() < 0.3
    fore = rng.uniform(0.36, 0.46)
    stock = hunting_stock(rng, -0.02, fore, rng.uniform(0, 0.012), rng.uniform() < 0.4)
    thin = 0.0105 if heavy else 0.0078
    end = 0.2 + length
    steel = [
        turned(
            filleted(np.array([(0.012, 0), (0.0165, 0.006), (0.0165, 0.2), (0.015, 0.21)]), 0.004),
            (0, 0.0, 0.008),
            (0, 1, 0),
            40,
        ),
        barrel(0.19, end, 0.0155, thin, int(rng.integers(0, 2))).translate((0, 0, 0.008)),
        rod((0, -0.045, 0.008), (0, 0.02, 0.008), 0.0095),
        bolt_handle(0.02, 0.006),
        trigger(0.05, -0.044, 0.062),
        along_y([(0.055, -0.052, -0.03, 0.028), (0.16, -0.051, -0.03, 0.028)], 6, 4, 28),
    ]
    if rng.uniform() < 0.4:
        steel.append(box_magazine(rng, 0.105, -0.045, 0, rng.uniform(0.03, 0.07), 0.02, 0.075))
    port = box((0.03, 0.075, 0.014), (-0.014, 0.1, 0.016))
    extras: list[Part] = []
    if rng.uniform() < 0.75:
        steel.append(union([box((0.014, 0.03, 0.016), (0, at, 0.028)) for at in (0.03, 0.17)]))
        extras = scope(rng, 0.1, 0.062)
    else:
        steel += [
            post(end - 0.02, 0.008, 0.034, False),
            plank([(0.2, 0.018), (0.205, 0.034), (0.216, 0.034), (0.23, 0.018)], 0.002, 0.012, 0.001),
        ]
    if rng.uniform() < 0.25:
        steel.append(muzzle(rng, end, thin, int(rng.integers(3))).translate((0, 0, 0.008)))
    look = dark_metal(rng) if rng.uniform() < 0.7 else metal(rng, ["steel"])
    parts = [
        Part(cut(union(steel), [port]), look),
        part(stock, furniture(rng, 0.7)),
        Part(butt_pad(stock), Material("rubber-pad", (34, 28, 26), 0, 0.9)),
    ]
    return parts + extras


def carbine_stock(rng, kind: int) -> list[Manifold]:
    """A telescoping, a fixed or a skeleton butt stock behind y = 0 (bore z = 0)."""
    reach = rng.uniform(0.17, 0.25)
    tube = rod((0, -reach + 0.01, -0.006), (0, 0.02, -0.006), 0.0148)
    if kind == 0:
        body = plank(
            [
                (-reach + 0.13, 0.014),
                (-reach, 0.016),
                (-reach - 0.01, -0.1),
                (-reach + 0.02, -0.118),
                (-reach + 0.05, -0.06),
                (-reach + 0.13, -0.03),
            ],
            [0.006, 0.006, 0.006, 0.008, 0.03, 0.006],
            0.036,
            0.008,
        )
        holes = [
            plank(
                [
                    (-reach + 0.018, -0.028),
                    (-reach + 0.085, -0.03),
                    (-reach + 0.04, -0.055),
                    (-reach + 0.02, -0.085),
                ],
                0.008,
                0.06,
                0,
            )
        ]
        return [cut(body, holes), tube]
    if kind == 1:
        body = along_y(
            [
                (-reach - 0.05, -0.125, 0.012, 0.036),
                (-reach - 0.035, -0.128, 0.014, 0.042),
                (-0.1, -0.055, 0.014, 0.04),
                (-0.005, -0.028, 0.016, 0.034),
            ],
            3.2,
            40,
            36,
        )
        return [body]
    bars = [
        sweep(
            filleted(
                np.array(
                    [
                        (0, 0.01, -0.012),
                        (0, -reach, -0.012),
                        (0, -reach - 0.02, -0.012),
                        (0, -reach - 0.02, -0.11),
                    ]
                ),
                0.012,
            ),
            superellipse(0.012, 0.012, 3, 24),
        ),
        sweep(
            filleted(np.array([(0, 0.005, -0.034), (0, -reach, -0.09), (0, -reach - 0.02, -0.1)]), 0.012),
            superellipse(0.01, 0.01, 3, 20),
        ),
        plank(
            [
                (-reach - 0.026, 0.0),
                (-reach - 0.012, 0.0),
                (-reach - 0.012, -0.125),
                (-reach - 0.026, -0.125),
            ],
            0.005,
            0.034,
            0.005,
        ),
    ]
    return bars


def handguard(rng, start: float, end: float, radius: float) -> Manifold:
    """A handguard with slots or holes all round."""
    kind = int(rng.integers(3))
    if kind == 0:
        length = end - start
        ribs = np.arange(0.03, length - 0.015, 0.012)
        wave = [
            (factor * radius, at + step)
            for at in ribs
            for factor, step in ((1, 0), (1, 0.006), (0.88, 0.007), (0.88, 0.011))
        ]
        profile = [
            (radius * 1.08, 0),
            (radius * 1.08, 0.02),
            *wave,
            (radius, length - 0.01),
            (0.9 * radius, length),
        ]
        return turned(np.array(profile), (0, start, 0), (0, 1, 0), 44)
    flat = superellipse(2 * radius, 2 * radius, 4 if kind == 1 else 2.2, 40)
    body = sweep([(0, start, 0), (0, end, 0)], flat)
    slots = []
    for at in np.arange(start + 0.03, end - 0.03, 0.042):
        for angle in (0, 90, 45) if kind == 2 else (0, 90):
            slots.append(
                sweep([(-0.1, at, 0), (0.1, at, 0)], superellipse(0.028, 0.007, 5, 16), side=(0, 1, 0)).rotate(
                    (0, angle, 0)
                )
            )
    core = rod((0, start, 0), (0, end, 0), 0.72 * radius)
    return cut(body, slots) + core


def carbine(rng) -> list[Part]:
    """An AR: flat-top receiver, buffer tube, pistol grip, handguard, magazine, optic or carry handle."""
    guard_end = 0.2 + rng.uniform(0.17, 0.33)
    end = guard_end + rng.uniform(0.05, 0.22)
    receiver = plank(
        [
            (0, -0.034),
            (0, 0.02),
            (0.012, 0.026),
            (0.2, 0.026),
            (0.2, -0.026),
            (0.155, -0.034),
            (0.15, -0.07),
            (0.088, -0.07),
            (0.082, -0.036),
        ],
        [0.004, 0.004, 0.004, 0.002, 0.003, 0.004, 0.003, 0.003, 0.004],
        0.031,
        0.004,
    )
    details = [
        box((0.006, 0.06, 0.014), (-0.0145, 0.115, 0.004)),
        rod((-0.012, 0.045, 0.004), (-0.0225, 0.035, 0.004), 0.0065, segments=20),
        rod((-0.0175, 0.03, -0.022), (0.0175, 0.03, -0.022), 0.004, segments=18),
        rod((-0.0175, 0.17, -0.02), (0.0175, 0.17, -0.02), 0.004, segments=18),
        box((0.038, 0.012, 0.007), (0, -0.004, 0.017)),
        rail(0.004, 0.198, 0.026),
    ]
    radius = rng.uniform(0.021, 0.026)
    steel = [
        receiver,
        *details,
        barrel(0.18, end, 0.011, 0.0085),
        muzzle(rng, end, 0.0085),
        trigger(0.082, -0.034, 0.05),
    ]
    sights = int(rng.integers(4))
    extras: list[Part] = []
    if sights == 0:
        handle = plank(
            [(0.01, 0.024), (0.012, 0.085), (0.165, 0.078), (0.185, 0.024)],
            [0.002, 0.01, 0.012, 0.002],
            0.02,
            0.003,
        )
        steel += [
            handle - plank([(0.045, 0.03), (0.04, 0.066), (0.145, 0.063), (0.155, 0.03)], 0.008, 0.05, 0),
            post(guard_end + 0.025, 0.0, 0.068),
        ]
    elif sights == 1:
        extras = scope(rng, 0.1, 0.074, rng.uniform(0.22, 0.28))
    elif sights == 2:
        extras = red_dot(0.1, 0.034, rng.uniform() < 0.5)
    else:
        steel += [
            post(guard_end + 0.02, 0.0, 0.062),
            plank([(0.01, 0.03), (0.012, 0.062), (0.024, 0.062), (0.03, 0.03)], 0.002, 0.014, 0.001),
        ]
    forward = [handguard(rng, 0.2, guard_end, radius)]
    if rng.uniform() < 0.5:
        steel.append(rail(0.205, guard_end - 0.005, radius - 0.001))
    if rng.uniform() < 0.3:
        forward.append(pistol_grip(rng, guard_end - 0.06, -0.02, 0.07))
    magazine = box_magazine(rng, 0.118, -0.07, rng.choice([0.0, 0.35, 0.45]), rng.uniform(0.08, 0.15))
    dark = dark_metal(rng)
    look = furniture(rng, 0.05)
    kind = int(rng.integers(3))
    butt = union(carbine_stock(rng, kind))
    plastics = union([pistol_grip(rng, 0.012, -0.034), *forward] + ([butt] if kind < 2 else []))
    if kind == 2:
        steel.append(butt)
    if rng.uniform() < 0.2:
        steel.append(bipod(rng, guard_end - 0.02, -radius))
    tan = choose(rng, POLYMER, 0.2, 0.5)
    magazine_look = Material(
        "magazine", tan.colour if rng.uniform() < 0.4 else tuple(int(0.8 * c) for c in dark.colour), 0.4, 0.5
    )
    return [Part(union(steel), dark), part(plastics, look), Part(magazine, magazine_look), *extras]


def kalashnikov(rng) -> list[Part]:
    """An AK: stamped receiver, gas tube over the barrel, sickle magazine, wood or polymer furniture."""
    end = 0.3 + rng.uniform(0.22, 0.36)
    receiver = plank(
        [
            (0.0, -0.042),
            (-0.004, 0.014),
            (0.01, 0.03),
            (0.2, 0.03),
            (0.262, 0.02),
            (0.262, -0.03),
            (0.2, -0.042),
        ],
        [0.004, 0.01, 0.012, 0.01, 0.003, 0.003, 0.003],
        0.032,
        0.006,
    )
    steel = [
        receiver,
        barrel(0.25, end, 0.0105, 0.0078, 1),
        muzzle(rng, end, 0.0078, int(rng.choice([0, 1, 3]))),
        post(end - 0.03, 0.0, 0.058),
        rod((0, 0.25, 0.026), (0, 0.47, 0.026), 0.009),
        box((0.022, 0.03, 0.05), (0, 0.472, 0.012)),
        plank([(0.255, 0.02), (0.262, 0.052), (0.3, 0.056), (0.31, 0.02)], 0.003, 0.02, 0.002),
        trigger(0.075, -0.042, 0.055, 0.03),
        box((0.004, 0.11, 0.012), (-0.017, 0.12, 0.012)),
        rod((-0.014, 0.16, 0.014), (-0.04, 0.165, 0.016), 0.004, segments=16),
        rod((0, 0.47, -0.012), (0, end - 0.02, -0.012), 0.0025, segments=12),
    ]
    lower = along_y(
        [
            (0.262, -0.036, 0.006, 0.034),
            (0.32, -0.042, 0.006, 0.042),
            (0.4, -0.04, 0.006, 0.04),
            (0.448, -0.03, 0.006, 0.032),
        ],
        3,
        30,
        36,
    )
    upper = along_y([(0.3, 0.01, 0.04, 0.03), (0.37, 0.01, 0.044, 0.034), (0.448, 0.01, 0.04, 0.028)], 2.6, 20, 32)
    woodwork = [lower, upper, pistol_grip(rng, 0.018, -0.04, 0.095)]
    kind = int(rng.choice([1, 1, 3, 2]))
    if kind == 1:
        butt = -rng.uniform(0.22, 0.27)
        woodwork.append(
            along_y(
                [
                    (butt, -0.145, -0.022, 0.036),
                    (butt + 0.012, -0.148, -0.018, 0.04),
                    (-0.1, -0.086, -0.006, 0.038),
                    (0.004, -0.036, 0.012, 0.03),
                ],
                3,
                44,
                36,
            )
        )
    elif kind == 2:
        steel += carbine_stock(rng, 2)
    else:
        steel.append(rod((0, -0.2, -0.01), (0, 0.02, -0.01), 0.014))
        woodwork.append(carbine_stock(rng, 0)[0])
    magazine = box_magazine(rng, 0.155, -0.04, rng.uniform(0.55, 0.85), rng.uniform(0.16, 0.21), 0.024, 0.062)
    extras: list[Part] = []
    if rng.uniform() < 0.3:
        steel.append(rail(0.02, 0.2, 0.029))
        extras = red_dot(0.1, 0.037, rng.uniform() < 0.5) if rng.uniform() < 0.6 else scope(rng, 0.1, 0.075, 0.25)
    dark = dark_metal(rng)
    magazine_look = Material(
        "magazine",
        (120, 52, 24) if rng.uniform() < 0.3 else tuple(int(0.85 * c) for c in dark.colour),
        0.4,
        0.45,
    )
    return [
        Part(union(steel), dark),
        part(union(woodwork), furniture(rng, 0.7)),
        Part(magazine, magazine_look),
        *extras,
    ]


def lever_action(rng) -> list[Part]:
    """A lever gun: straight wood stock, steel or brass receiver, tube magazine below the barrel, loop."""
    end = 0.16 + rng.uniform(0.42, 0.62)
    receiver = plank(
        [(-0.005, -0.04), (0.0, 0.012), (0.02, 0.024), (0.16, 0.022), (0.16, -0.042)],
        [0.004, 0.008, 0.006, 0.003, 0.003],
        0.03,
        0.003,
    )
    loop = filleted(
        np.array(
            [
                (0, 0.06, -0.036),
                (0, 0.052, -0.075),
                (0, 0.0, -0.072),
                (0, -0.02, -0.06),
                (0, -0.045, -0.09),
                (0, -0.12, -0.088),
                (0, -0.128, -0.07),
                (0, -0.03, -0.045),
            ]
        ),
        0.013,
    )
    hammer = plank(
        [(-0.008, 0.0), (-0.014, 0.03), (-0.022, 0.036), (-0.018, 0.042), (0.002, 0.03), (0.006, 0.0)],
        0.002,
        0.008,
        0.001,
    )
    steel = [
        barrel(0.15, end, 0.0125, 0.009).translate((0, 0, 0.008)),
        rod((0, 0.15, -0.016), (0, end - rng.uniform(0.01, 0.2), -0.016), 0.0085),
        sweep(loop, superellipse(0.012, 0.005, 3, 20)),
        hammer,
        post(end - 0.02, 0.01, 0.036, False),
        trigger(0.05, -0.04, 0.045, 0.026),
        plank([(0.17, 0.014), (0.175, 0.034), (0.184, 0.034), (0.2, 0.014)], 0.002, 0.012, 0.001),
        box((0.026, 0.012, 0.046), (0, end - 0.07, -0.004)),
    ]
    butt = -rng.uniform(0.3, 0.36)
    stock = along_y(
        [
            (butt, -0.15, -0.05, 0.03),
            (butt + 0.014, -0.152, -0.042, 0.036),
            (-0.16, -0.088, -0.018, 0.038),
            (-0.06, -0.05, -0.008, 0.034),
            (0.01, -0.036, 0.008, 0.028),
        ],
        2.4,
        60,
        36,
    )
    fore = along_y(
        [
            (0.155, -0.034, 0.006, 0.032),
            (0.24, -0.034, 0.006, 0.036),
            (0.37, -0.03, 0.004, 0.032),
            (0.39, -0.026, 0.0, 0.022),
        ],
        2.6,
        36,
        36,
    )
    plate = along_y([(butt - 0.004, -0.15, -0.048, 0.03), (butt + 0.002, -0.152, -0.046, 0.033)], 2.4, 4, 36)
    extras = scope(rng, 0.08, 0.056, 0.26) if rng.uniform() < 0.2 else []
    receiver_look = metal(rng, ["brass"]) if rng.uniform() < 0.5 else metal(rng, ["steel"])
    return [
        Part(union(steel), dark_metal(rng)),
        Part(union([receiver, plate]), receiver_look),
        part(stock + fore, furniture(rng, 0.9)),
        *extras,
    ]


def bullpup(rng) -> list[Part]:
    """A bullpup: the magazine behind the grip, one shell from butt to handguard."""
    end = rng.uniform(0.5, 0.64)
    high, low = rng.uniform(0.03, 0.045), -rng.uniform(0.04, 0.055)
    butt = -0.27
    shell = plank(
        [
            (butt, high - 0.005),
            (butt - 0.006, low - 0.07),
            (butt + 0.03, low - 0.075),
            (-0.12, low - 0.022),
            (-0.1, low - 0.035),
            (-0.02, low - 0.03),
            (0.0, low),
            (0.13, low),
            (0.17, low - 0.005),
            (0.33, low + 0.012),
            (0.35, 0.01),
            (0.28, high - 0.004),
        ],
        [0.01, 0.012, 0.012, 0.02, 0.006, 0.006, 0.01, 0.02, 0.02, 0.01, 0.012, 0.03],
        rng.uniform(0.042, 0.052),
        0.01,
    )
    shell = cut(
        shell,
        [
            box((0.03, 0.08, 0.02), (-0.028, -0.09, 0.01)),
            *[box((0.008, 0.006, 0.04), (s * 0.026, y, 0)) for s in (-1, 1) for y in np.arange(0.2, 0.32, 0.016)],
        ],
    )
    grip = pistol_grip(rng, 0.055, low + 0.004, 0.09)
    if rng.uniform() < 0.5:
        hole = sweep([(-0.1, 0.0, 0), (0.1, 0.0, 0)], superellipse(0.035, 0.02, 3, 28), side=(0, 1, 0)).translate(
            (0, butt + 0.075, low - 0.012)
        )
        shell -= hole
    steel = [
        barrel(0.3, end, 0.0115, 0.009),
        muzzle(rng, end, 0.009),
        trigger(0.13, low, 0.055, 0.03),
        rod((0.02, 0.25, high - 0.012), (0.045, 0.25, high - 0.012), 0.0045, segments=18),
    ]
    extras: list[Part] = []
    if rng.uniform() < 0.4:
        stem = [
            plank(
                [(0.02, high - 0.006), (0.03, high + 0.034), (0.05, high + 0.034), (0.05, high - 0.006)],
                0.003,
                0.014,
                0.002,
            ),
            plank(
                [(0.2, high - 0.01), (0.2, high + 0.034), (0.22, high + 0.034), (0.235, high - 0.01)],
                0.003,
                0.014,
                0.002,
            ),
        ]
        steel += [
            *stem,
            turned(
                filleted(np.array([(0.0143, 0), (0.0143, 0.24)]), 0.003),
                (0, 0.01, high + 0.042),
                (0, 1, 0),
                36,
            ),
        ]
    else:
        steel.append(rail(0.0, 0.27, high - 0.002))
        extras = (
            red_dot(0.12, high + 0.006, rng.uniform() < 0.5)
            if rng.uniform() < 0.6
            else scope(rng, 0.12, high + 0.046, 0.25)
        )
    magazine = box_magazine(rng, -0.06, low - 0.028, rng.choice([0.0, 0.3, 0.4]), rng.uniform(0.1, 0.14))
    pad = plank(
        [
            (butt + 0.004, high - 0.008),
            (butt - 0.016, high - 0.008),
            (butt - 0.022, low - 0.068),
            (butt - 0.002, low - 0.068),
        ],
        0.004,
        0.036,
        0.005,
    )
    return [
        Part(shell + grip, polymer(rng)),
        Part(union(steel), dark_metal(rng)),
        Part(magazine, Material("magazine", (44, 44, 48), 0.3, 0.5)),
        Part(pad, Material("rubber-pad", (30, 28, 28), 0, 0.9)),
        *extras,
    ]


def sniper(rng) -> list[Part]:
    """A precision rifle: chassis or thumbhole stock, heavy fluted barrel, big scope, bipod, brake."""
    end = 0.24 + rng.uniform(0.52, 0.7)
    thick = rng.uniform(0.012, 0.0145)
    tube = barrel(0.2, end, 0.0165, thick)
    flutes = [
        rod(
            (np.cos(a) * (thick + 0.004), 0.45, np.sin(a) * (thick + 0.004)),
            (np.cos(a) * (thick + 0.004), end - 0.06, np.sin(a) * (thick + 0.004)),
            0.0052,
            segments=14,
        )
        for a in np.pi / 3 * np.arange(6)
    ]
    if rng.uniform() < 0.7:
        tube = cut(tube, flutes)
    steel = [
        turned(filleted(np.array([(0.014, 0), (0.018, 0.006), (0.018, 0.22)]), 0.003), (0, 0, 0), (0, 1, 0), 40),
        tube,
        muzzle(rng, end, thick, int(rng.choice([1, 1, 2]))),
        bolt_handle(0.03, 0.0),
        rail(0.005, 0.215, 0.016),
        trigger(0.065, -0.044, 0.055),
    ]
    butt = -rng.uniform(0.27, 0.31)
    if rng.uniform() < 0.5:
        fore_end = rng.uniform(0.4, 0.5)
        body = [
            plank(
                [
                    (-0.01, -0.046),
                    (-0.01, -0.004),
                    (fore_end, -0.004),
                    (fore_end - 0.004, -0.036),
                    (0.17, -0.05),
                ],
                0.006,
                0.044,
                0.006,
            ),
            pistol_grip(rng, 0.0, -0.044, 0.1),
            plank([(0.0, -0.012), (butt, 0.0), (butt, -0.024), (0.0, -0.04)], 0.004, 0.03, 0.006),
            plank(
                [(butt + 0.16, 0.034), (butt + 0.03, 0.036), (butt + 0.03, 0.004), (butt + 0.16, -0.002)],
                0.01,
                0.034,
                0.01,
            ),
            plank(
                [(butt + 0.01, 0.024), (butt - 0.02, 0.022), (butt - 0.024, -0.12), (butt + 0.012, -0.12)],
                0.008,
                0.036,
                0.008,
            ),
            plank(
                [
                    (butt + 0.012, -0.094),
                    (butt + 0.006, -0.116),
                    (-0.16, -0.062),
                    (-0.1, -0.034),
                    (-0.13, -0.034),
                ],
                0.006,
                0.022,
                0.005,
            ),
        ]
        slots = [
            sweep([(-0.1, y, -0.02), (0.1, y, -0.02)], superellipse(0.03, 0.008, 4, 24), side=(0, 1, 0))
            for y in np.arange(0.24, fore_end - 0.03, 0.045)
        ]
        stock = cut(union(body), slots)
    else:
        stock = hunting_stock(rng, -0.02, rng.uniform(0.42, 0.5), 0.014, True)
        hole = sweep([(-0.1, -0.055, -0.05), (0.1, -0.055, -0.05)], superellipse(0.05, 0.032, 2.4, 32), side=(0, 1, 0))
        stock = (
            stock
            + along_y(
                [
                    (-0.15, -0.12, -0.03, 0.036),
                    (-0.08, -0.135, -0.01, 0.036),
                    (-0.03, -0.13, -0.02, 0.034),
                    (-0.012, -0.1, -0.04, 0.02),
                ],
                2.5,
                30,
                36,
            )
            - hole
        )
    steel.append(box_magazine(rng, 0.12, -0.044, 0, rng.uniform(0.04, 0.08), 0.024, 0.08))
    if rng.uniform() < 0.75:
        steel.append(bipod(rng, 0.38, -0.034))
    return [
        Part(union(steel), dark_metal(rng)),
        part(stock, furniture(rng, 0.15)),
        *scope(rng, 0.1, 0.06, rng.uniform(0.32, 0.4)),
    ]


def battle_rifle(rng) -> list[Part]:
    """A wood-stocked self-loader: M1, M14 or a military bolt rifle with a long handguard and bands."""
    end = 0.26 + rng.uniform(0.4, 0.52)
    fore = end - rng.uniform(0.1, 0.22)
    stock = hunting_stock(rng, -0.02, fore, 0.0, False)
    upper = along_y(
        [
            (0.24, -0.004, 0.02, 0.03),
            (0.3, -0.004, 0.024, 0.034),
            (fore - 0.03, -0.004, 0.019, 0.027),
            (fore - 0.02, -0.004, 0.016, 0.024),
        ],
        2.3,
        30,
        32,
    )
    steel = [
        plank(
            [
                (-0.01, -0.016),
                (-0.006, 0.02),
                (0.03, 0.03),
                (0.09, 0.026),
                (0.1, 0.016),
                (0.2, 0.016),
                (0.21, 0.026),
                (0.25, 0.024),
                (0.25, -0.016),
            ],
            0.003,
            0.03,
            0.004,
        ),
        barrel(0.23, end, 0.012, 0.0085, 2).translate((0, 0, 0.004)),
        post(end - 0.03, 0.002, 0.036),
        trigger(0.055, -0.044, 0.06),
        rod((-0.012, 0.18, 0.0083), (-0.036, 0.18, 0.0103), 0.0043, segments=18),
        muzzle(rng, end, 0.0085, int(rng.choice([0, 3]))).translate((0, 0, 0.004)),
        plank([(0.2, 0.02), (0.205, 0.042), (0.22, 0.042), (0.23, 0.02)], 0.002, 0.018, 0.001),
        rod((0, fore - 0.05, -0.012), (0, fore + 0.06, -0.012), 0.007),
    ]
    bands = [
        along_y([(at, -0.039, 0.024, 0.047), (at + 0.012, -0.038, 0.024, 0.046)], 2.5, 3, 36)
        for at in (0.62 * fore, fore - 0.035)
    ]
    if rng.uniform() < 0.6:
        steel.append(box_magazine(rng, 0.11, -0.04, rng.choice([0.0, 0.25]), rng.uniform(0.05, 0.12), 0.026, 0.07))
    if rng.uniform() < 0.3:
        blade = plank(
            [(end + 0.0, -0.02), (end + 0.22, -0.014), (end + 0.24, -0.008), (end + 0.0, 0.0)],
            0.001,
            0.005,
            0.0012,
        )
        steel += [blade.translate((0, 0, -0.008)), box((0.014, 0.05, 0.03), (0, end - 0.02, -0.01))]
    extras = scope(rng, 0.1, 0.068, 0.27) if rng.uniform() < 0.2 else []
    if extras:
        steel.append(box((0.014, 0.1, 0.02), (0, 0.1, 0.034)))
    plate = along_y(
        [
            (stock.bounding_box()[1] - 0.004, -0.15, -0.03, 0.036),
            (stock.bounding_box()[1] + 0.004, -0.15, -0.025, 0.04),
        ],
        2.8,
        4,
        36,
    )
    return [
        Part(union(steel + bands), dark_metal(rng)),
        part(stock + upper, furniture(rng, 0.85)),
        Part(plate, metal(rng, ["steel"])),
        *extras,
    ]


def double_barrel(rng) -> list[Part]:
    """A break-action with two barrels, side by side or one over the other."""
    end = 0.1 + rng.uniform(0.5, 0.72)
    over = rng.uniform() < 0.5
    bore = 0.0115
    offsets = [(0, bore), (0, -bore)] if over else [(bore, 0), (-bore, 0)]
    tubes = [
        turned(np.array([(0.0128, 0), (0.0118, 0.1), (0.0108, end - 0.1)]), (x, 0.1, z), (0, 1, 0), 36)
        - rod((x, end - 0.05, z), (x, end + 0.02, z), 0.0085, segments=28)
        for x, z in offsets
    ]
    rib = box((0.006, end - 0.1, 0.006), (0, 0.1 + (end - 0.1) / 2, (bore if over else 0) + 0.0125))
    bead = Manifold.sphere(0.0022, 16).translate((0, end - 0.006, (bore if over else 0) + 0.0165))
    deep = 0.03 if over else 0.02
    width = 0.04 if over else 0.05
    action = plank(
        [
            (-0.02, -0.03),
            (-0.025, 0.008),
            (0.03, deep),
            (0.1, deep),
            (0.1, -deep - 0.006),
            (0.02, -deep - 0.01),
        ],
        [0.01, 0.01, 0.01, 0.003, 0.004, 0.01],
        width,
        0.006,
    )
    lever = along_y(
        [(-0.05, 0.012, 0.018, 0.008), (-0.02, 0.014, 0.022, 0.01), (0.0, 0.012, 0.024, 0.016)], 2.5, 12, 24
    )
    steel = [*tubes, rib, bead]
    butt = -rng.uniform(0.34, 0.38)
    wrist = rng.uniform(-0.085, -0.05)
    stock = along_y(
        [
            (butt, -0.165, -0.055, 0.036),
            (butt + 0.014, -0.168, -0.046, 0.042),
            (-0.2, -0.11, -0.034, 0.042),
            (-0.11, wrist, -0.026, 0.036),
            (-0.06, -0.056, -0.012, 0.036),
            (0.0, -0.034, 0.012, 0.042),
        ],
        2.4,
        70,
        40,
    )
    fore = along_y(
        [
            (0.1, -deep - 0.016, 0.0, width),
            (0.2, -deep - 0.016, 0.0, width * 1.05),
            (0.3, -deep - 0.008, 0.0, width * 0.9),
            (0.33, -deep, -0.002, width * 0.6),
        ],
        2.6,
        40,
        40,
    )
    bright = metal(rng, ["steel", "brass"]) if rng.uniform() < 0.7 else dark_metal(rng)
    guards = trigger(0.03, -0.034, 0.075, 0.03)
    material = Material("action", bright.colour, bright.metallic, bright.roughness)
    return [
        Part(union(steel), dark_metal(rng)),
        Part(union([action, lever, guards]), material),
        part(stock + fore, furniture(rng, 0.95)),
        Part(butt_pad(stock), Material("rubber-pad", (60, 26, 20), 0, 0.9)),
    ]


STYLES = (
    bolt_action,
    carbine,
    kalashnikov,
    lever_action,
    sniper,
    bullpup,
    battle_rifle,
    carbine,
    double_barrel,
    bolt_action,
)
