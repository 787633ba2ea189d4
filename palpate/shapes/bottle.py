"""Bottles that stand on z = 0 around the z axis: a body of any cross-section, reliefs, a top, handles and labels."""

from types import SimpleNamespace

import numpy as np
from manifold3d import Manifold
from numpy.random import Generator
from scipy.interpolate import PchipInterpolator

from palpate.shapes.materials import Material, Part, across, around, choose, label
from palpate.shapes.solids import (
    arctan2,
    bent_bar,
    box,
    filleted,
    fluted,
    lathe,
    rod,
    superellipse,
    turned,
    union,
    upright,
)

AXES = (2, 1)
# Points around a body, and rows from the ground to the neck: facets of 1.5 and about 3 degrees; ribs need more rows.
PLAIN, RIBBED = (240, 60), (150, 104)
WIDEST = 0.32  # radius over height of a body that has handles
PAPER = 0.0005  # m that a label stands off the body


def build(p: SimpleNamespace, rng: Generator) -> list[Part]:
    """Body, top, handle and label by the parameters."""
    profile, section = outline(p)
    body = upright(profile, section)
    radius, neck = p.slimness * p.height, p.neck * p.slimness * p.height
    look = choose(rng, p.material)
    for side in {"none": [], "loop": [1], "pair": [1, -1]}[p.handle if p.slimness < WIDEST else "none"]:
        body += handle(p, profile, section).scale((1, side, 1))
    if p.top == "open":
        tool = [(0.75 * neck, p.height + 0.01), (0.7 * neck, 0.8 * p.height), (0, 0.78 * p.height)]
        body -= lathe(filleted(tool, 0.3 * neck), 72)
    parts = [Part(body, look), *top(p, rng, neck, radius)]
    if p.label == "none":
        return parts
    low, high = (share * p.shoulder * p.height for share in (p.label_low, p.label_high))
    rows = (profile[:, 1] > low) & (profile[:, 1] < high)
    levels = np.concatenate([[low], profile[rows, 1], [high]])
    ends = cut_at(profile, section, low), cut_at(profile, section, high)
    outlines = np.concatenate([ends[0], profile[rows, :1, None] * section[rows], ends[1]]) * (1 + PAPER / radius)
    sticker = upright(np.column_stack([np.ones(len(levels)), levels]), outlines)
    if p.label == "front":
        wide = p.label_width * radius
        return [*parts, Part(sticker ^ box((2 * radius, wide, 1), (radius, 0, 0)), label(rng), across)]
    if p.label == "sleeve":
        return [*parts, Part(sticker, label(rng), around)]
    return [*parts, Part(sticker, Material("grip", (60, 60, 64), 0, 0.8))]


def outline(p: SimpleNamespace) -> tuple[np.ndarray, np.ndarray]:
    """The body's profile (k, 2) of (radius, z), and its cross-sections (k, m, 2) for radius 1."""
    radius, end = p.slimness * p.height, p.shoulder * p.height
    neck, start = p.neck * radius, (1 - p.neck_length) * p.height
    start = max(start, end + 0.05 * p.height)
    widths = np.array([p.base, p.lower, p.middle, p.upper, 1])
    # Half of each width is its neighbours': a body has a waist or a belly, and no zigzag.
    widths[1:-1] = widths[1:-1] / 2 + (widths[:-2] + widths[2:]) / 4
    count, rows = RIBBED if p.relief == "ribs" else PLAIN
    knots = PchipInterpolator([0, 0.25, 0.5, 0.75, 1], widths)
    heel = p.heel * radius * p.base
    angle = np.linspace(0, np.pi / 2, 16)[:-1]
    body = np.linspace(heel, end, 200)
    z = np.concatenate([heel * (1 - np.cos(angle)), body])
    r = radius * knots(z / end)
    r[: len(angle)] -= heel * (1 - np.sin(angle))
    if p.relief == "ribs":
        wave = 0.5 - 0.5 * np.cos(2 * np.pi * p.relief_count * (body - heel) / (end - heel))
        r[len(angle) :] -= p.relief_depth * radius * wave
    t = np.linspace(0, 1, 100)[1:]
    dome = np.float_power(1 - np.float_power(t, p.dome), p.hollow)
    shoulder = np.column_stack([neck + (radius - neck) * dome, end + t * (start - end)])
    skin = np.concatenate([np.column_stack([r, z]), shoulder])
    # Closer rows where it curves: facets turn alike. A sharp corner needs one, a wall that may be bent some.
    steps = np.diff(skin, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    turns = np.abs(np.diff(np.unwrap(arctan2(steps[:, 1], steps[:, 0]))))
    place = np.append(0, np.cumsum(np.append(np.minimum(turns, 0.1), 0) + 0.7 * lengths / lengths.sum()))
    chosen = np.searchsorted(place, np.linspace(0, place[-1], rows) - 1e-9)
    skin = skin[np.unique(np.minimum(chosen, len(skin) - 1))]
    lip = np.array([(1, 0), (1, 0.3), (1 + p.finish, 0.34), (1 + p.finish, 0.66), (1, 0.7), (1, 1)])
    lip = np.column_stack([neck * lip[:, 0], start + (p.height - start) * lip[:, 1]])[1:]
    profile = np.concatenate([[(0.5 * r[0], 0)], skin, lip])
    body_share = 1 - np.clip((profile[:, 1] - end) / (start - end), 0, 1)[:, None, None]
    section = superellipse(2, 2, p.squareness, count) * [p.depth, 1]
    section = body_share * section + (1 - body_share) * superellipse(2, 2, 2, count)
    if p.relief == "flutes":
        envelope = np.float_power(np.sin(np.pi * np.clip(profile[:, 1] / end, 0, 1)), 0.7) * p.relief_depth
        section = section * np.linalg.norm(fluted(envelope, 2 * p.relief_count, count), axis=-1, keepdims=True)
    # Corners turn less than grooves: a square bottle keeps four sides.
    spiral = p.spiral if p.squareness < 2.6 else 0.25 * p.spiral
    angle = np.radians(spiral) * np.clip(profile[:, 1] / end, 0, 1)
    cosine, sine = np.cos(angle)[:, None], np.sin(angle)[:, None]
    x, y = section[..., 0], section[..., 1]
    return profile, np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)


def cut_at(profile: np.ndarray, section: np.ndarray, z: float) -> np.ndarray:
    """The body's outline (1, m, 2) at height z."""
    above = int(np.searchsorted(profile[:, 1], z))
    share = (z - profile[above - 1, 1]) / (profile[above, 1] - profile[above - 1, 1])
    rings = profile[above - 1 : above + 1, 0, None, None] * section[above - 1 : above + 1]
    return ((1 - share) * rings[0] + share * rings[1])[None]


def handle(p: SimpleNamespace, profile: np.ndarray, section: np.ndarray) -> Manifold:
    """A loop from the neck or shoulder down to the body."""
    angle, radius = np.radians(p.handle_turn), p.slimness * p.height
    low, high = p.handle_low * p.height, p.handle_high * p.height

    def surface(z: float) -> float:
        ring = cut_at(profile, section, z)[0]
        return float(np.linalg.norm(ring[np.argmax(np.cos(arctan2(ring[:, 1], ring[:, 0]) - angle))]))

    thick = p.handle_width * radius
    out = min(surface(low) + p.handle_reach * radius, 0.44 * p.height)
    path = [(0, surface(high) - 0.4 * thick, high), (0, out, high), (0, out, low), (0, surface(low) - 0.4 * thick, low)]
    return bent_bar(path, 0.4 * (high - low), 1.2 * thick, 0.8 * thick, 2.5, 32).rotate((0, 0, p.handle_turn - 90))


def screw_cap(radius: float, low: float, height: float, taper: float) -> Manifold:
    """A knurled cap with a rounded top."""
    top = low + height
    profile = filleted([(radius, low), (taper * radius, top), (1e-3 * radius, top)], [0, 0.15 * height, 0])
    return upright(profile, fluted(0.05, 36, 288))


def top(p: SimpleNamespace, rng: Generator, neck: float, radius: float) -> list[Part]:
    """What closes the mouth, at the bottle's height."""
    # A cap stays narrower than the body, and a spout short enough that the bottle stands and is taller than wide.
    h, wide, tall = p.height, min(p.top_width * neck, 1.1 * radius), min(p.top_height * neck, 1.2 * radius)
    cap_look = choose(rng, "plastic", [f"{colour}-plastic" for colour in ("white", "black", "red", "green", "blue")])
    collar = screw_cap(wide, h - 0.6 * neck, 0.6 * neck + 0.4 * tall, p.top_taper)
    end = h + 0.4 * tall
    if p.top == "open":
        return []
    if p.top == "crown":
        profile = np.array([(1.22, -0.35), (1.12, -0.15), (1.0, 0.08), (0.85, 0.15)]) * neck + [0, h]
        teeth = fluted([0.1, 0.05, 0, 0], 21, 168)
        return [Part(upright(profile, teeth), choose(rng, "metal" if rng.uniform() < 0.5 else "plastic"))]
    if p.top == "cork":
        sides = [(0.7 * neck, h - neck), (0.75 * neck, h), (0.6 * wide, h + 0.6 * tall), (0, h + 0.6 * tall)]
        return [Part(lathe(filleted(sides, 0.1 * neck), 72), Material("cork", (196, 158, 110), 0, 0.8))]
    if p.top == "capsule":
        low = h - min(p.neck_length, 0.2) * rng.uniform(0.5, 1) * h
        foil = [(1.03 * neck, low), ((1.06 + p.finish) * neck, h - 0.3 * neck)]
        foil += [(1.05 * neck, h + 0.05 * neck), (0, h + 0.08 * neck)]
        return [Part(lathe(filleted(foil, 0.1 * neck), 128), Material("foil", cap_look.colour, 0.6, 0.3))]
    if p.top == "stopper":
        knots = rng.uniform(0.7, 1.3, 5) * wide
        z = np.linspace(0, 1, 24)
        curve = np.append(PchipInterpolator(np.linspace(0, 1, 6), [*knots, 0.3 * wide])(z), 0)
        ball = np.column_stack([curve, h + 0.01 * neck + 1.4 * tall * np.append(z, 1)])
        plug = rod((0, 0, h - neck), (0, 0, h + 0.1 * tall), 0.7 * neck)
        look = [choose(rng, "metal"), choose(rng, "wood"), choose(rng, "glass"), cap_look][rng.integers(4)]
        return [Part(lathe(ball, 96) + plug, look)]
    if p.top == "cap":
        profile = [(wide, h - 0.3 * neck), (p.top_taper * wide, h + tall), (0.5 * wide, h + tall)]
        squared = superellipse(2, 2, rng.uniform(2, 7), 96) * [rng.uniform(0.6, 1), 1]
        return [Part(upright(filleted(profile, [0, 0.1 * tall, 0]), squared), cap_look)]
    if p.top == "screw":
        return [Part(screw_cap(wide, h + 0.15 * neck - 0.7 * tall, 0.7 * tall, p.top_taper), cap_look)]
    reach, turn, more = min(p.reach * radius, 0.25 * h), (0, 0, p.top_turn), []  # from here on they point to +y first
    if p.top == "nozzle":
        cone = [(0.55 * neck, end - 0.1 * neck), (0.45 * neck, end), (0.15 * neck, end + reach), (0, end + reach)]
        solid = collar + lathe(filleted(cone, 0.05 * neck), 48)
    elif p.top == "dropper":
        bulb = np.array([(0.9, -0.1), (0.8, 0.5), (1, 1.2), (0.7, 2), (0, 2.2)]) * [0.75 * neck, 0.35 * tall] + [0, end]
        rubber = Part(lathe(filleted(bulb, 0.4 * neck), 72), Material("rubber", (40, 38, 38), 0, 0.8))
        return [Part(collar, cap_look), rubber]
    elif p.top == "pump":
        z = end + rng.uniform(0.5, 1.1) * min(radius, 0.16 * h)
        spout = [(0, -0.5 * neck, z), (0, 0.8 * reach, z + 0.1 * neck), (0, reach, z - 0.5 * neck)]
        spout = bent_bar(spout, 0.4 * neck, 0.9 * neck, 0.6 * neck, 2.5, 32)
        solid = union([collar, rod((0, 0, h), (0, 0, z), 0.35 * neck), spout])
    elif p.top == "straw":
        straw = [(0, 0, h), (0, 0, end + 0.3 * reach), (0, 0.5 * reach, end + 0.8 * reach)]
        solid = collar + bent_bar(straw, 0.4 * reach, 0.7 * neck, 0.6 * neck, 2.5, 32)
    elif p.top in ("loop", "swing"):
        span, low, high, thin = 0.85 * wide, end - 0.3 * neck, end + 0.7 * reach, 0.2 if p.top == "swing" else 0.45
        path = [(0, -span, low), (0, -span, high), (0, span, high), (0, span, low)]
        solid = collar + bent_bar(path, 0.6 * span, 2 * thin * neck, thin * neck, 3, 24)
    else:  # a sprayer's head with nozzle and trigger
        rise, slope = rng.uniform(0.5, 1.6) * neck, rng.uniform(-0.2, 0.3) * neck
        z, back = end + rise + neck, rng.uniform(0.8, 1.8) * neck
        spine = [(0, -back, z - slope), (0, 0, z), (0, 1.2 * reach, z + 0.5 * slope)]
        head = bent_bar(spine, neck, 1.4 * neck, 1.6 * neck, 3, 40)
        solid = union([head, rod((0, 0, end - 0.3 * neck), (0, 0, z), 0.75 * neck), collar])
        drop, at = rng.uniform(1.6, 3.2) * neck, 0.75 * reach
        path = [(0, at, z), (0, at + 0.4 * neck, z - 0.5 * drop), (0, at - 0.2 * neck, z - drop)]
        trigger = bent_bar(path, neck, 0.8 * neck, 0.35 * neck, 3, 28)
        trigger += turned([(0.55 * neck, 0), (0.45 * neck, neck)], (0, 1.15 * reach, z + 0.4 * slope), (0, 1, 0), 32)
        more = [Part(trigger.rotate(turn), Material("trigger", tuple(int(c) for c in rng.integers(40, 230, 3))))]
    return [Part(solid.rotate(turn), cap_look), *more]
