"""Rifles: receiver, barrel, stock, grip, fore-end, magazine, sight, muzzle and what hangs below the barrel. Metres; the
bore lies along y at z = 0, the muzzle towards +y; the receiver's back is at y = 0, the stock at y < 0; up is +z."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
from manifold3d import Manifold
from numpy.random import Generator
from numpy.typing import ArrayLike

from palpate.shapes.materials import Material, Part, choose
from palpate.shapes.solids import along_y, bent_bar, box, cut, filleted, prism, rod, superellipse, sweep, turned, union

AXES = (1, 2)
OPTIC = Material("optic", (24, 24, 28), 0.4, 0.35)
GLASS = Material("optic-glass", (60, 90, 140), 0.3, 0.05)


def build(p: SimpleNamespace, rng: Generator) -> list[Part]:
    """All parts by the parameters, in one frame."""
    wooden = p.wood == "yes" and p.stock not in ("skeleton", "carbine")
    furniture, dark = choose(rng, "wood" if wooden else "polymer"), choose(rng, "dark metal")
    look = dark if p.metal_look == "dark" else choose(rng, "metal", [p.metal_look])
    trigger_at = 0.62 * p.receiver if p.bullpup == "yes" else 0.075
    frame, steel = receiver(p), [*barrels(p), *muzzle(p, rng), *action(p)]
    if p.action != "lever":
        frame += trigger(trigger_at, -p.low)
    plastics = [*stock(p), *forend(p)]
    if p.grip == "pistol" or p.bullpup == "yes" or p.stock in ("skeleton", "carbine"):
        plastics.append(pistol_grip(trigger_at - 0.06, -p.low, p.grip_length, p.rake, p.grip_depth))
    solids, below_look = below(p)
    parts = [Part(frame, look), Part(union(steel), dark), Part(union(plastics), furniture), *sight(p, rng)]
    if p.magazine != "none":
        parts.append(Part(magazine(p), Material("magazine", tuple(int(0.8 * c) for c in dark.colour), 0.4, 0.5)))
    if solids:
        parts.append(Part(union(solids), below_look))
    return [replace(part, solid=part.solid.scale((p.bulk, 1, p.bulk))) for part in parts]


def plank(points: ArrayLike, radii: ArrayLike, thickness: float, edge: float) -> Manifold:
    """A plate in y-z from corner points with fillets, its rim rounded."""
    return prism(filleted(points, radii, closed=True), thickness, edge)


def receiver(p: SimpleNamespace) -> Manifold:
    """A block from y = 0, its top falling to the front, and a port on its right (-x)."""
    front, back = p.high * (1 - max(p.body_slope, 0)), p.high * (1 + min(p.body_slope, 0))
    points = [(0, -p.low), (0, back), (0.1 * p.receiver, p.high if p.body_slope < 0 else back)]
    points += [(0.75 * p.receiver, p.high if p.body_slope > 0 else front), (p.receiver, front)]
    points += [(p.receiver, -0.75 * p.low), (0.8 * p.receiver, -p.low)]
    block = plank(points, 0.2 * p.low, p.body_width, 0.15 * p.low)
    return block - box((0.01, 0.3 * p.receiver, 0.5 * p.high), (-p.body_width / 2, 0.55 * p.receiver, 0.3 * p.high))


def barrels(p: SimpleNamespace) -> list[Manifold]:
    """The barrel, and what lies along it."""
    start, length, thick, thin = p.receiver - 0.02, p.barrel + 0.02, p.bore, p.slim * p.bore
    profile = [(thick, 0), (thick, 0.15 * length), (0.5 * (thick + thin), 0.3 * length), (thin, length), (0, length)]
    tube = turned(profile, (0, start, 0), (0, 1, 0), 64)
    tube -= rod((0, start + length - 0.03, 0), (0, start + length + 0.01, 0), 0.45 * thin, segments=24)
    end = p.receiver + p.second_length * p.barrel
    if p.second == "none":
        return [tube]
    if p.second == "gas":
        z = 2 * thick + 0.004
        block = box((1.6 * thick, 0.03, z + thick), (0, end, z / 2))
        return [tube, rod((0, p.receiver - 0.01, z), (0, end, z), 0.85 * thick), block]
    if p.second == "tube":
        z = -2.05 * thick
        stations = [(end - 0.06 + at, z - 1.1 * thick, 1.15 * thick, 2.5 * thick) for at in (0, 0.015)]
        ring = along_y(stations, 2.4, 3)
        return [tube, rod((0, p.receiver - 0.01, z), (0, end, z), 0.95 * thick), ring]
    shift = (0, 0, thick) if p.second == "over" else (thick, 0, 0)
    rib = box((0.006, p.barrel, 0.006), (0, p.receiver + p.barrel / 2, shift[2] + 0.95 * thick))
    return [tube.translate(shift), tube.translate(tuple(-c for c in shift)), rib]


def muzzle(p: SimpleNamespace, rng: Generator) -> list[Manifold]:
    """The end of the barrel: a flash hider, a brake with ports, or a suppressor."""
    size, end, radius = p.muzzle_size, p.receiver + p.barrel, p.slim * p.bore
    tools = [rod((0, end, 0), (0, end + 0.4, 0), 0.55 * radius, segments=20)]
    if p.muzzle == "hider":
        profile = [(radius + 0.003, 0), (radius + 0.004, 0.05 * size), (0.005, 0.05 * size)]
        tools += [box((0.002, 0.03 * size, 0.03), (0, end + 0.018 * size, 0)).rotate((0, a, 0)) for a in (0, 60, 120)]
    elif p.muzzle == "brake":
        profile = [(radius + 0.006, 0), (radius + 0.006, 0.07 * size), (0.005, 0.07 * size)]
        tools += [box((0.06, 0.008 * size, 1.3 * radius), (0, end + at * size, 0)) for at in (0.012, 0.028, 0.044)]
    elif p.muzzle == "suppressor":
        length, wide = 0.17 * size, rng.uniform(0.016, 0.023)
        profile = [(wide * 0.8, 0), (wide, 0.008), (wide, length), (0.006, length)]
    else:
        return []
    return [cut(turned(filleted(profile, 0.0015), (0, end - 0.012, 0), (0, 1, 0), 64), tools)]


def action(p: SimpleNamespace) -> list[Manifold]:
    """A bolt with its handle, a charging handle, or a lever with its loop and a hammer."""
    if p.action == "bolt":
        path = filleted([(0, 0.03, 0), (-p.body_width, 0.026, -0.004), (-1.5 * p.body_width, 0.01, -0.03)], 0.015)
        knob = Manifold.sphere(0.0095, 28).translate(tuple(path[-1]))
        bolt = rod((0, -0.045, 0.3 * p.high), (0, 0.04, 0.3 * p.high), 0.55 * p.high)
        return [sweep(path, superellipse(0.009, 0.009, 2, 20), side=(0, 1, 0)), knob, bolt]
    if p.action == "charging":
        inner, outer = ((share * p.body_width, 0.75 * p.receiver, 0.4 * p.high) for share in (-0.4, -1.2))
        return [rod(inner, outer, 0.0045, segments=20)]
    if p.action == "lever":
        outline = [(0.06, 0.005), (0.052, -0.035), (0, -0.032), (-0.02, -0.02)]
        outline += [(-0.045, -0.05), (-0.12, -0.05), (-0.13, -0.02), (-0.03, 0.005)]
        spur = [(0, -0.01), (-0.014, 0.02), (-0.022, 0.026), (-0.018, 0.032), (0.004, 0.02), (0.006, -0.01)]
        hammer = plank(np.array(spur) + [0, 0.5 * p.high], 0.002, 0.008, 0.001)
        loop = bent_bar([(0, y, z - p.low) for y, z in outline], 0.013, 0.012, 0.005, 3, 20)
        return [loop, hammer, trigger(0.05, -p.low, 0.045, 0.03)]
    return []


def trigger(y: float, z: float, length: float = 0.06, drop: float = 0.032) -> Manifold:
    """A trigger and its guard below a receiver's underside z; the guard spans y - length .. y."""
    path = [(0, y, z + 0.006), (0, y - 0.004, z - drop), (0, y - length + 0.004, z - drop), (0, y - length, z + 0.006)]
    blade = [(0, y - s * length, z - d) for s, d in ((0.5, -0.006), (0.56, 0.45 * drop), (0.46, 0.8 * drop))]
    return bent_bar(path, 0.014, 0.011, 0.003, 4, 20) + bent_bar(blade, 0.03, 0.006, 0.004, 3, 16)


def pistol_grip(y: float, z: float, length: float, rake: float, depth: float) -> Manifold:
    """A raked grip below (y, z)."""
    lean = rake * length
    path = filleted([(0, y, z + 0.012), (0, y - 0.3 * lean, z - 0.3 * length), (0, y - lean, z - length)], 0.08)
    scale = np.linspace(1, 0, len(path))[:, None] * [-0.04, 0.12] + [1, 1.0]
    return sweep(path, superellipse(0.7 * depth, depth, 2.8, 64), scale)


def stock(p: SimpleNamespace) -> list[Manifold]:
    """The butt stock, from the receiver's back to y = -stock_length."""
    end, heel, wide = -p.stock_length, -p.drop, p.stock_width
    toe, comb = heel - p.butt, max(heel, -0.004) + p.comb
    if p.stock in ("straight", "thumbhole"):
        wrist = -p.low - (0.015 if p.stock == "straight" else 0.05)
        stations = [
            (end, toe + 0.006, heel - 0.004, 0.8 * wide),
            (end + 0.014, toe, heel, wide),
            (0.62 * end, 0.7 * toe + 0.2 * wrist, 0.5 * (heel + comb), wide),
            (0.3 * end, wrist - 0.02, -0.01 + 0.5 * p.comb, 0.95 * wide),
            (0.12 * end, wrist, -0.012, 0.85 * wide),
            (0.01, -p.low, 0.3 * p.high, 0.9 * p.body_width),
        ]
        body = along_y(stations, 2.6, 80, 64)
        if p.comb > 0.008:
            rise = [(0.8, heel, 0.4), (0.7, comb, 0.8), (0.45, comb, 0.8), (0.35, -0.01, 0.4)]
            body += along_y([(y * end, -0.03, z, share * wide) for y, z, share in rise], 2.4, 24, 32)
        if p.stock == "thumbhole":
            path = [(x, 0.27 * end, -0.5 * p.low - 0.02) for x in (-0.1, 0.1)]
            body -= sweep(path, superellipse(0.45 * p.butt, 0.3 * p.butt, 2.4, 32), side=(0, 1, 0))
        return [body]
    if p.stock == "shell":
        points = [(end, 0.8 * p.high), (end - p.pitch, toe), (end + 0.05, toe), (0.3 * end, -p.low - 0.03)]
        points += [(0.01, -p.low - 0.01), (p.receiver, -p.low), (0.9 * p.receiver, 0.7 * p.high), (0, 1.05 * p.high)]
        return [plank(points, 0.012, 1.15 * p.body_width, 0.006)]
    low = -0.5 * p.low
    tube = rod((0, end + 0.01, low / 2), (0, 0.02, low / 2), 0.35 * p.low)
    outline = [(end, heel), (end - 0.016, heel), (end - 0.016 - p.pitch, toe), (end - p.pitch, toe)]
    plate = plank(outline, 0.007, wide, 0.004)
    if p.stock == "skeleton":
        strut = [(0, 0.01, -0.8 * p.low), (0, 0.5 * end, -0.8 * p.low - 0.1 * p.butt)]
        strut.append((0, end - 0.008 - p.pitch, toe + 0.02))
        return [tube, plate, bent_bar(strut, 0.05, 0.011, 0.013, 3, 24)]
    body = [(0.45 * end, 0.3 * p.low + p.comb), (end, heel + 0.3 * p.low), (end - p.pitch, toe), (end + 0.03, toe)]
    body += [(0.75 * end, low - 0.45 * p.butt), (0.45 * end, -0.8 * p.low)]
    hole = [(end + 0.02, heel - 0.3 * p.butt), (0.7 * end, heel - 0.3 * p.butt), (end + 0.025, heel - 0.62 * p.butt)]
    return [tube, plate, cut(plank(body, 0.008, 0.9 * wide, 0.007), [plank(hole, 0.006, 0.1, 0)])]


def forend(p: SimpleNamespace) -> list[Manifold]:
    """The fore-end round the barrel, before the receiver."""
    start, size = p.receiver - 0.005, max(p.forend_size, 1.25 * p.bore)
    end = p.receiver + p.forend_length * p.barrel
    drop = 2.1 * p.bore if p.second in ("tube", "over") else 0
    if p.forend == "none":
        return []
    if p.forend == "wood":
        width = max(2 * size, 4.4 * p.bore if p.second == "side" else 0)
        stations = [
            (0.3 * p.receiver, -p.low - 0.006, -0.4 * p.low, 1.05 * p.body_width),
            (start, -size - drop - 0.012, 0.001, width),
            (0.5 * (start + end), -size - drop, 0.001, 0.95 * width),
            (end - 0.02, -0.8 * size - drop, 0, 0.8 * width),
            (end, -0.6 * size - drop, -0.006, 0.5 * width),
        ]
        return [along_y(stations, 2.6, 60, 64)]
    if p.forend == "pump":
        start, z = start + 0.3 * p.barrel, -2.05 * p.bore
        share = np.linspace(0, 1, 60)
        radius = size * (1 - 0.06 * np.cos(2 * np.pi * 9 * share)) * (1 - 0.1 * np.float_power(2 * share - 1, 4))
        pump = np.column_stack([radius, share * max(0.08, 0.4 * (end - p.receiver))])
        return [turned(pump, (0, start, z), (0, 1, 0), 64)]
    length = end - start
    if p.forend == "ribbed":
        at = np.arange(0.03, max(length - 0.015, 0.04), 0.014)
        wave = [(f * size, a + step) for a in at for f, step in ((1, 0), (1, 0.007), (0.86, 0.008), (0.86, 0.013))]
        last = wave[-1][1]
        profile = [(size * 1.08, 0), (size * 1.08, 0.02), *wave, (size, last + 0.004), (0.9 * size, last + 0.014)]
        return [turned(profile, (0, start, 0), (0, 1, 0), 64)]
    body = sweep([(0, start, 0), (0, end, 0)], superellipse(1.8 * size, 2 * size, 4, 48))
    slot = sweep([(-0.1, 0, 0), (0.1, 0, 0)], superellipse(0.028, 0.4 * size, 5, 16), side=(0, 1, 0))
    at = np.arange(start + 0.03, end - 0.025, 0.042)
    slots = [slot.rotate((0, angle, 0)).translate((0, y, 0)) for y in at for angle in (0, 90)]
    return [cut(body, slots), rod((0, start, 0), (0, end, 0), 0.7 * size)]


def magazine(p: SimpleNamespace) -> Manifold:
    """The magazine below the receiver: straight, bent forwards, or round."""
    length, depth, z = p.magazine_length, p.magazine_depth, 0.015 - p.low
    y = -0.3 * p.stock_length if p.bullpup == "yes" else 0.075 + 0.6 * depth + (p.magazine_place - 0.5) * p.receiver
    s = np.linspace(0, 1, 14)
    if p.magazine == "curved":
        radius = length / p.curve
        path = np.column_stack([0 * s, y + radius * (1 - np.cos(p.curve * s)), z - radius * np.sin(p.curve * s)])
    else:
        path = np.column_stack([0 * s, y + 0.08 * length * s, z - (length if p.magazine == "box" else 0.045) * s])
    if p.magazine == "drum":
        radius, half = 0.3 * length + 0.02, 0.6 * depth
        middle = (0, y, z - 0.03 - radius)
        drum = turned(filleted([(radius, -half), (radius, half)], 0.004), middle, (0, 1, 0), 56)
        return drum + sweep(path, superellipse(0.026, depth, 7, 32))
    body = sweep(path, superellipse(0.024, depth, 7, 32))
    groove = sweep(path[3:12], superellipse(0.004, 0.1 * depth, 2, 12))
    body = cut(body, [groove.translate((side * 0.012, at * depth, 0)) for side in (-1, 1) for at in (-0.2, 0.12)])
    along = (path[-1] - path[-2]) / np.linalg.norm(path[-1] - path[-2])
    foot = [path[-1] - 0.004 * along, path[-1] + 0.006 * along]
    return body + sweep(foot, superellipse(0.029, depth + 0.006, 6, 32))


def sight(p: SimpleNamespace, rng: Generator) -> list[Part]:
    """The sight above the receiver: two irons, a telescope, a dot sight, a carrying handle, or nothing."""
    size, y, top = p.sight_size, p.sight_place * p.receiver, 0.7 * p.high
    if p.sight == "none":
        return []
    if p.sight in ("irons", "carry"):
        rise = p.high + (0.05 if p.sight == "carry" else 0.02) * size + p.sight_rise
        front = p.receiver + 0.93 * p.barrel
        leaf = [(front - 0.016, -0.004), (front - 0.004, rise), (front + 0.004, rise), (front + 0.012, -0.004)]
        solids = [plank(leaf, 0.002, 0.008, 0.001)]
        if p.sight == "irons":
            rear = np.array([(-0.02, top), (-0.012, rise), (0.004, rise), (0.03, top)]) + [0.9 * p.receiver, 0]
            return [Part(union([*solids, plank(rear, 0.002, 0.014, 0.001)]), OPTIC)]
        scale, shift = [0.8 * p.receiver, 1], [0.05 * p.receiver, 0]
        handle = np.array([(0.05, top), (0.06, rise), (0.9, rise - 0.006), (1, top)]) * scale + shift
        hollow = np.array([(0.25, p.high + 0.004), (0.22, rise - 0.012), (0.78, rise - 0.016), (0.84, p.high + 0.004)])
        hollow = plank(hollow * scale + shift, 0.003, 0.05, 0)
        return [Part(union([*solids, plank(handle, 0.006, 0.02, 0.003) - hollow]), OPTIC)]
    tube = 0.0135 * size
    front, eye, half = tube * rng.uniform(1.1, 2.2), tube * rng.uniform(1.2, 1.7), p.sight_length / 2
    z = p.high + p.sight_rise + (front if p.sight == "scope" else 1.6 * tube) + 0.004
    feet = [box((0.014, 0.018, z - top), (0, y + at * half, (z + top) / 2)) for at in (-0.35, 0.3)]
    if p.sight == "dot":
        half, front, eye = 0.15 * p.sight_length, 1.4 * tube, 1.4 * tube
        profile = [(front, -half), (front, half)]
        feet = [box((0.018, half, z - top), (0, y, (z + top) / 2))]
    else:
        profile = [(eye, -half), (eye, -0.6 * half), (tube, -0.45 * half)]
        profile += [(tube, 0.3 * half), (front, 0.6 * half), (front, half)]
    body = turned(filleted(profile, 0.008), (0, y, z), (0, 1, 0), 40)
    knob = filleted([(0.8 * tube, 0), (0.8 * tube, 2 * tube), (0, 2 * tube)], 0.002)
    knobs = [turned(knob, (0, y - 0.1 * half, z), axis, 28) for axis in ((0, 0, 1), (-1, 0, 0))]
    ends = [(half, front), (-half, eye)]
    cups = [rod((0, y + 0.95 * at, z), (0, y + 1.05 * at, z), 0.86 * r, segments=28) for at, r in ends]
    lenses = [rod((0, y + 0.9 * at, z), (0, y + 0.97 * at, z), 0.88 * r, segments=28) for at, r in ends]
    return [Part(union([cut(body, cups), *feet, *knobs]), OPTIC), Part(union(lenses), GLASS)]


def below(p: SimpleNamespace) -> tuple[list[Manifold], Material]:
    """What hangs below the barrel."""
    size, y = p.below_size, p.receiver + p.below_place * p.barrel
    z = -max(p.forend_size if p.forend_length > p.below_place and p.forend != "none" else 0, 0.8 * p.bore)
    look = Material("below", (38, 38, 42), 0.4, 0.5)
    if p.below == "bipod":
        length, turn = 0.22 * size, np.radians(10 + 75 * max(p.spread, 0))
        legs = [box((0.04, 0.03, 0.03), (0, y, z + 0.006))]
        for side in (-1, 1):
            hip = np.array([side * 0.016, y, z - 0.004])
            foot = hip + length * np.array([0.4 * side * np.sin(turn), np.cos(turn), -np.sin(turn)])
            knee = hip + 0.55 * (foot - hip)
            legs += [rod(hip, knee, 0.0075, segments=24), rod(knee - 0.02 * (foot - hip), foot, 0.005, segments=24)]
            legs.append(Manifold.sphere(0.009, 24).translate(tuple(foot)))
        return legs, look
    if p.below == "foregrip":
        return [pistol_grip(y, z, 0.085 * size, 0.2 * (p.spread - 0.4), 0.036)], look
    if p.below == "launcher":
        radius = 0.021 * size
        low = z - 0.9 * radius
        tube = rod((0, y - 0.1 * size, low), (0, y + 0.12 * size, low), radius)
        tube -= rod((0, y + 0.06 * size, low), (0, y + 0.2 * size, low), 0.8 * radius)
        return [tube, pistol_grip(y - 0.06 * size, low - 0.5 * radius, 0.06 * size, 0.3, 0.03)], look
    if p.below == "bayonet":
        end = p.receiver + p.barrel
        points = np.array([(-0.02, -1), (0.2, -0.9), (0.25, -0.6), (-0.02, -0.3)]) * [size, 2 * p.bore] - [0, p.bore]
        blade = plank(points + [end, 0], 0.002, 0.005, 0.001)
        bayonet = Material("bayonet", (192, 194, 198), 0.9, 0.3)
        return [blade, box((0.012, 0.05, 3 * p.bore), (0, end - 0.03, -1.6 * p.bore))], bayonet
    return [], look
