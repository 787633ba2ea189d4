"""Knives: one blade of any outline, with teeth and holes; handles, guards and pommels; folding knives half open.

Metres; the long axis is y with the tip towards +y, the edge faces -z, the flat side faces +x. The blade begins at
y = 0, its handle lies at y < 0 around z = 0.
"""

from types import SimpleNamespace

import numpy as np
from manifold3d import Manifold
from scipy.interpolate import PchipInterpolator

from palpate.shapes.assembly import Part
from palpate.shapes.deformation import form
from palpate.shapes.materials import Material, across, dark_metal, metal, plastic, polymer, wood
from palpate.shapes.parameters import Choice, Range
from palpate.shapes.solids import along_y, box, cut, filleted, loft, prism, rod, superellipse, sweep, union

AXES = (1, 2)
# m. A sharp edge's thickness: what a whetted edge has is below what a mesh in float32 and a sensor can tell.
EDGE = 0.0004
POINT = 0.0012  # m, height of a blade at its very tip
STATIONS = 90  # along a blade

PARAMETERS = {
    "blade": {
        "length": Range(0.1, 0.2, "m", "from the handle to the tip"),
        "height": Range(0.12, 0.24, "1", "largest height over the length"),
        "thickness": Range(0.0018, 0.0045, "m", "at the back, at the handle"),
        "edges": Choice("single", "single or double, as a dagger's"),
        "heel": Range(0.7, 1, "1", "height at the handle over the largest"),
        "offset": Range(-0.15, 0.1, "1", "how far the blade sits above the handle's middle, over its height"),
        "point": Range(0.1, 0.9, "1", "height of the tip: 0 at the edge, 1 at the back"),
        "blunt": Range(0, 0.05, "1", "height that is left at the tip over the largest"),
        "fold": Range(0, 0, "degrees", "how far a folding knife is closed"),
    },
    "outline": {
        "clip": Range(0.3, 0.85, "1", "where the back begins to drop, over the length"),
        "clip_power": Range(0.8, 3, "1", "how it drops: 1 straight, 3 late"),
        "belly": Range(0.2, 0.85, "1", "where the edge begins to rise, over the length"),
        "belly_power": Range(1.4, 3.5, "1", "how it rises"),
        "bulge": Range(-0.15, 0.2, "1", "growth of the height in the middle of the blade"),
        "wave": Range(-0.12, 0.12, "1", "depth of an S in the edge over the height"),
        "droop": Range(-0.05, 0.05, "1", "how far the tip sinks by the curve of the whole blade, over its length"),
    },
    "grind": {
        "bevel": Range(0.25, 0.85, "1", "share of the height that is ground"),
        "teeth": Choice("none none none scallops saw", "none, in the edge, or in the back"),
        "pitch": Range(0.0035, 0.009, "m", "from tooth to tooth"),
        "toothed": Range(0.3, 0.95, "1", "where teeth end, over the length"),
        "side": Choice("none none groove hole dents", "what is cut into the flat side"),
    },
    "handle": {
        "grip": Range(0.09, 0.135, "m", "length of the handle"),
        "tall": Range(0.16, 0.27, "1", "height of the handle over its length"),
        "wide": Range(0.5, 0.9, "1", "thickness of the handle over its height"),
        "squareness": Range(2, 4.5, "1", "exponent of the cross-section: 2 is an ellipse, 6 nearly a rectangle"),
        "neck": Range(0.7, 1, "1", "height at a tenth of the handle over the whole"),
        "palm": Range(0.9, 1.15, "1", "the same at the middle"),
        "waist": Range(0.75, 1.05, "1", "the same at three quarters"),
        "butt": Range(0.8, 1.3, "1", "the same near the end"),
        "sag": Range(-0.04, 0.14, "1", "how far the end of the handle sinks, over its length"),
        "tilt": Range(-10, 6, "degrees", "turn of the handle against the blade"),
        "rings": Range(0, 0.01, "1", "depth of rings along the handle over its height"),
        "rivets": Range(0, 4.99, "count", "pins through the handle"),
        "grip_material": Choice("wood polymer plastic", "of the handle"),
    },
    "guard": {
        "guard": Choice("none bolster cross", "between handle and blade; a bow goes round the fingers"),
        "reach": Range(0.7, 1.6, "1", "height of the guard over the handle's"),
        "sweep": Range(-0.5, 0.5, "1", "how far the guard's ends point to the tip, over its reach"),
        "guard_thick": Range(0.25, 0.5, "1", "thickness of the guard over the handle's height"),
    },
    "pommel": {
        "pommel": Choice("none none none cap ball ring", "at the end of the handle"),
        "pommel_size": Range(0.8, 1.5, "1", "over the handle's height"),
    },
    "form": form(stretch=0.25, twist=5, warp=0.03, bend=9, taper=0.04),
}

KITCHEN = {"guard": "none bolster", "pommel": "none", "grip_material": "wood polymer plastic", "rings": (0, 0.002)}
STYLES = {
    "chef": KITCHEN | {
        "length": (0.15, 0.27), "height": (0.13, 0.27), "offset": (-0.35, -0.15), "point": (0.35, 0.75),
        "clip": (0.2, 0.7), "belly": (0.05, 0.5), "teeth": "none", "side": "none", "heel": (0.95, 1),
    },
    "santoku": KITCHEN | {
        "length": (0.13, 0.19), "height": (0.22, 0.36), "offset": (-0.35, -0.15), "point": (0, 0.2),
        "clip": (0.6, 0.85), "clip_power": (1.6, 3), "heel": (0.95, 1), "side": "dents dents none", "teeth": "none",
    },
    "bread": KITCHEN | {
        "length": (0.19, 0.29), "height": (0.1, 0.17), "point": (0, 0.3), "clip": (0.7, 0.92), "teeth": "scallops",
        "toothed": (0.9, 0.97), "heel": (0.9, 1), "side": "none",
    },
    "paring": KITCHEN | {
        "length": (0.06, 0.11), "height": (0.17, 0.32), "grip": (0.085, 0.115), "droop": (-0.05, 0.25),
        "teeth": "none", "side": "none", "tall": (0.14, 0.2),
    },
    "cleaver": KITCHEN | {
        "length": (0.14, 0.22), "height": (0.36, 0.62), "blunt": (0.6, 0.95), "offset": (-0.4, -0.22),
        "clip": (0.6, 0.95), "belly": (0.3, 0.8), "side": "hole hole none", "teeth": "none", "heel": (0.85, 1),
        "thickness": (0.0025, 0.0055),
    },
    "steak": KITCHEN | {
        "length": (0.09, 0.14), "height": (0.12, 0.19), "teeth": "scallops", "pitch": (0.003, 0.005),
        "tall": (0.13, 0.18), "point": (0.3, 1), "side": "none",
    },
    "table": {
        "length": (0.08, 0.13), "height": (0.14, 0.26), "heel": (0.35, 0.8), "blunt": (0.02, 0.3), "clip": (0.6, 0.9),
        "belly": (0.5, 0.85), "teeth": "none scallops", "side": "none", "grip": (0.09, 0.13), "tall": (0.1, 0.17),
        "wide": (0.35, 0.7), "neck": (0.35, 0.7), "guard": "none", "pommel": "none", "grip_material": "steel",
        "rivets": (0, 0.5), "rings": (0, 0.002), "tilt": (-2, 2),
    },
    "folder": {
        "length": (0.065, 0.1), "height": (0.2, 0.36), "fold": (0, 66), "side": "hole groove none",
        "thickness": (0.003, 0.004), "grip": (0.1, 0.135), "wide": (0.4, 0.6), "squareness": (3, 6),
        "rivets": (2, 4.99), "guard": "none", "pommel": "none none ring",
    },
    "multitool": {
        "length": (0.055, 0.08), "height": (0.16, 0.3), "fold": (0, 62), "grip": (0.083, 0.11), "tall": (0.2, 0.34),
        "wide": (0.55, 0.95), "squareness": (3, 6), "guard": "none", "pommel": "none tool tool", "rivets": (2, 3),
        "grip_material": "plastic", "side": "groove", "sag": (-0.02, 0.02), "neck": (0.95, 1), "butt": (0.9, 1),
        "waist": (0.95, 1.02), "palm": (0.97, 1.05), "rings": (0, 0.002),
    },
    "hunting": {
        "length": (0.1, 0.2), "height": (0.17, 0.3), "thickness": (0.003, 0.0055), "point": (0.3, 1),
        "clip": (0.35, 0.75), "clip_power": (0.7, 1.8), "guard": "cross bolster", "pommel": "cap none",
        "grip_material": "wood",
    },
    "combat": {
        "length": (0.12, 0.2), "height": (0.16, 0.26), "thickness": (0.0035, 0.0055), "clip": (0.5, 0.85),
        "clip_power": (0.8, 1.4), "teeth": "saw saw scallops", "guard": "cross", "pommel": "cap",
        "grip_material": "polymer", "rings": (0.02, 0.07), "wide": (0.75, 0.95), "squareness": (2, 2.8),
    },
    "dagger": {
        "length": (0.13, 0.28), "height": (0.08, 0.24), "edges": "double", "point": (0.45, 0.55),
        "offset": (-0.02, 0.02), "clip": (0.05, 0.8), "belly": (0.05, 0.8), "thickness": (0.004, 0.0065),
        "wave": (-0.01, 0.01), "guard": "cross", "reach": (1.6, 4), "pommel": "ball ball ring", "rings": (0.01, 0.06),
        "teeth": "none", "side": "none groove", "tilt": (-1, 1), "sag": (-0.01, 0.01),
    },
    "cutter": {
        "length": (0.03, 0.09), "height": (0.2, 0.45), "heel": (0.95, 1), "point": (0.75, 1), "belly": (0.6, 0.8),
        "belly_power": (1, 1.2), "bulge": (-0.01, 0.01), "wave": (-0.01, 0.01), "side": "dents", "teeth": "none",
        "thickness": (0.0012, 0.0016), "grip": (0.12, 0.16), "tall": (0.14, 0.23), "wide": (0.45, 0.7),
        "squareness": (3, 6), "guard": "none", "pommel": "none", "grip_material": "plastic",
    },
    "machete": KITCHEN | {
        "length": (0.22, 0.38), "height": (0.1, 0.24), "heel": (0.4, 0.8), "bulge": (0, 0.3), "droop": (-0.1, 0.25),
        "thickness": (0.003, 0.0055), "pommel": "none none ball", "side": "none",
    },
    "karambit": {
        "length": (0.07, 0.13), "height": (0.22, 0.38), "droop": (0.25, 0.6), "point": (0.2, 0.7),
        "clip": (0.05, 0.4), "grip": (0.09, 0.12), "sag": (0.05, 0.2), "pommel": "ring", "guard": "none",
        "teeth": "none saw",
    },
    "sabre": {
        "length": (0.27, 0.4), "height": (0.055, 0.12), "droop": (-0.2, -0.02), "thickness": (0.004, 0.007),
        "clip": (0.6, 0.9), "belly": (0.5, 0.85), "guard": "bow cross bow", "reach": (1.6, 2.6), "pommel": "ball cap",
        "side": "groove none", "teeth": "none", "tilt": (-14, 0),
    },
}  # fmt: skip


def build(p: SimpleNamespace, rng: np.random.Generator) -> list[Part]:
    """Blade, handle, guard and pommel as the parameters say."""
    tall, wide = p.tall * p.grip, p.wide * p.tall * p.grip
    steel = [blade(p)]
    if p.fold > 0:
        pivot = np.array([0, -0.01, 0])
        steel[0] = steel[0].translate(-pivot).rotate((p.fold, 0, 0)).translate(pivot)
    grip, centre = handle(p, tall, wide)
    at = np.linspace(0.12, 0.85, p.rivets) if p.rivets > 1 else np.full(p.rivets, 0.15)
    half = wide / 2 + 0.0003
    steel += [
        rod((-half, -s * p.grip, centre(s)), (half, -s * p.grip, centre(s)), 0.11 * tall, segments=28) for s in at
    ]
    fittings = [*guard(p, tall, wide, centre), *pommel(p, rng, tall, wide, centre)]
    fittings = [solid.rotate((p.tilt, 0, 0)) for solid in fittings]
    steel = [steel[0], *(solid.rotate((p.tilt, 0, 0)) for solid in steel[1:])]
    if p.fold > 0:  # the slot that the blade folds into
        grip -= box((p.thickness + 0.0008, 0.9 * p.grip, tall), (0, -0.45 * p.grip, 0.45 * tall))
    looks = {
        "wood": wood,
        "polymer": polymer,
        "plastic": plastic,
        "steel": lambda rng: metal(rng, ["brass", "aluminium"]),
    }
    steel_look = metal(rng, ["steel"]) if rng.uniform() < 0.75 else dark_metal(rng)
    look = looks[p.grip_material](rng)
    parts = [Part(union(steel), steel_look), Part(grip.rotate((p.tilt, 0, 0)), look, across if look.picture else None)]
    if fittings:
        bright = metal(rng, ["brass", "steel", "copper"])
        parts.append(Part(union(fittings), Material("fittings", bright.colour, bright.metallic, bright.roughness)))
    return parts


def blade(p: SimpleNamespace) -> Manifold:
    """The blade, with what is cut into it, and a tang that reaches into the handle."""
    t = 1 - (1 - np.linspace(0, 1, STATIONS)) ** 1.5
    y, tallest = t * p.length, p.height * p.length
    grown = p.heel + (1 - p.heel) * np.clip(t / 0.2, 0, 1) ** 2 * (3 - 2 * np.clip(t / 0.2, 0, 1))
    full = tallest * grown * (1 + p.bulge * np.sin(np.pi * t) ** 2)
    middle = p.offset * tallest - p.droop * p.length * t**2
    drop = (1 - p.point) * np.clip((t - p.clip) / (1 - p.clip), 0, 1) ** p.clip_power
    rise = p.point * np.clip((t - p.belly) / (1 - p.belly), 0, 1) ** p.belly_power
    back = middle + full * (0.5 - (1 - p.blunt) * drop)
    edge = middle + full * (-0.5 + (1 - p.blunt) * rise + p.wave * np.sin(2 * np.pi * t) * (1 - t))
    solid = ground(y, back, edge, p.thickness * (1 - 0.5 * t), p.bevel, p.edges == "double")
    tools = []
    if p.teeth != "none":
        line, deep = (edge, 0.3 * p.pitch) if p.teeth == "scallops" else (back, -0.45 * p.pitch)
        at = np.arange(0.08 * p.length + p.pitch, p.toothed * p.length, p.pitch)
        for place, z in zip(at, np.interp(at, y, line), strict=True):
            if p.teeth == "scallops":
                z += deep - 0.75 * p.pitch
                tools.append(rod((-0.01, place, z), (0.01, place, z), 0.75 * p.pitch, segments=20))
            else:
                half = 0.42 * p.pitch
                tools.append(prism([(place - half, z + 0.002), (place, z + deep), (place + half, z + 0.002)], 0.02))
    upper = 0.72 * back + 0.28 * edge
    if p.side == "hole":
        place = 0.85 * p.length if p.blunt > 0.3 else 0.2 * p.length
        z = float(np.interp(place, y, upper))
        tools.append(rod((-0.01, place, z), (0.01, place, z), 0.14 * tallest))
    elif p.side == "groove":
        path = np.column_stack([0 * y, y, upper])[(t > 0.05) & (t < 0.55)]
        groove = sweep(path, superellipse(0.25 * p.thickness, 0.12 * tallest, 2, 20))
        tools += [groove.translate((side * 0.46 * p.thickness, 0, 0)) for side in (1, -1)]
    elif p.side == "dents":
        dent = Manifold.sphere(1, 20).scale((0.3 * p.thickness, 0.02 * p.length, 0.2 * tallest))
        for place in np.arange(0.15, 0.75, 0.065) * p.length:
            z = float(np.interp(place, y, middle))
            tools += [dent.translate((side * 0.47 * p.thickness, place, z)) for side in (1, -1)]
    # A folding blade ends behind its pivot.
    reach = 0.3 * p.grip if p.fold == 0 else 0.02
    tang = box((0.7 * p.thickness, reach + 0.004, 0.3 * p.tall * p.grip), (0, 0.002 - reach / 2, 0))
    return cut(solid, tools) + tang


def ground(y, spine, edge, thickness, bevel: float = 0.5, double: bool = False) -> Manifold:
    """A blade along y.

    y, spine, edge: (k,) positions, heights z of the back and of the edge; thickness: (k,) at the back; bevel: share
    of the height that is ground to the edge; double: ground to both sides (a dagger).
    """
    # Where back and edge would meet or cross, the back stays above.
    height = np.maximum(spine - edge, POINT)
    thickness = np.minimum(thickness, height)
    sharp = np.minimum(EDGE, thickness)
    spine_half = sharp / 2 if double else 0.94 * thickness / 2
    bevelled = edge + bevel * height
    back = edge + 0.96 * height
    if double:
        bevelled = back = edge + height / 2
    columns = [
        (spine_half, edge + height),
        (-spine_half, edge + height),
        (-thickness / 2, back),
        (-thickness / 2, bevelled - 1e-5),
        (-sharp / 2, edge),
        (sharp / 2, edge),
        (thickness / 2, bevelled - 1e-5),
        (thickness / 2, back),
    ]
    return loft(np.stack([np.stack([x, y, z], -1) for x, z in columns], axis=1))


def handle(p: SimpleNamespace, tall: float, wide: float):
    """The handle behind y = 0, and its middle line: height z at a share of its length."""

    def centre(share):
        return -p.sag * p.grip * np.asarray(share) ** 2

    knots = PchipInterpolator(
        [0, 0.1, 0.5, 0.75, 0.95, 1], [0.9 * p.neck, p.neck, p.palm, p.waist, p.butt, 0.75 * p.butt]
    )
    s = np.linspace(0, 1, 100)
    size = knots(s) * (1 + p.rings * np.cos(2 * np.pi * 9 * s))
    width = wide * (0.5 + 0.5 * size / size.max())
    stations = np.column_stack([-p.grip * s, centre(s) - size * tall / 2, centre(s) + size * tall / 2, width])
    return along_y(stations[::-1], p.squareness, 90, 48), centre


def guard(p: SimpleNamespace, tall: float, wide: float, centre) -> list[Manifold]:
    """What is between handle and blade."""
    thick, reach = p.guard_thick * tall, p.reach * tall
    if p.guard == "none":
        return []
    if p.guard == "bolster":
        half = 0.52 * p.neck * tall
        return [
            along_y(
                [(-thick, -half, half, wide), (0, -half, half, wide), (thick, -0.8 * half, 0.8 * half, 0.3 * wide)], 3
            )
        ]
    ahead = p.sweep * reach / 2
    path = [(0, ahead, reach / 2), (0, 0, 0.25 * reach), (0, 0, -0.25 * reach), (0, ahead, -reach / 2)]
    bar = sweep(filleted(np.array(path), 0.3 * reach), superellipse(1.05 * wide, thick, 3, 32))
    if p.guard == "cross":
        return [bar]
    low, end = -0.5 * reach, float(centre(1))
    path = [(0, 0, low), (0, -0.25 * p.grip, low - 0.3 * tall), (0, -0.8 * p.grip, low - 0.3 * tall), (0, -p.grip, end)]
    return [bar, sweep(filleted(np.array(path), 0.03), superellipse(0.7 * wide, 0.35 * thick, 2.5, 28))]


def pommel(p: SimpleNamespace, rng: np.random.Generator, tall: float, wide: float, centre) -> list[Manifold]:
    """What is at the end of the handle."""
    size, end = p.pommel_size * tall / 2, float(centre(1))
    if p.pommel == "none" or (p.pommel == "tool" and p.fold == 0):
        return []
    if p.pommel == "ball":
        shape = rng.uniform(0.7, 1.3, 2)
        ball = Manifold.sphere(0.6 * size, 48).scale((min(1, wide / size), *shape))
        return [ball.translate((0, -p.grip - 0.3 * size, end))]
    if p.pommel == "cap":
        back = -p.grip - rng.uniform(0.3, 0.9) * size
        stations = [
            (back, end - 0.7 * size, end + 0.7 * size, 0.8 * wide),
            (-p.grip, end - size, end + size, 1.03 * wide),
        ]
        return [along_y(stations, 3, 12)]
    if p.pommel == "ring":
        return [hoop(np.array([-p.grip - 0.7 * size, end]), 0.9 * size, 0.3 * size, 0.5 * wide)]
    blade_out, turn = rng.uniform(0.35, 0.8) * p.grip, rng.uniform(20, 75)
    tool = filleted(
        np.array([(0, 0.1), (-1, 0.06), (-1, -0.06), (0, -0.1)]) * [blade_out, blade_out], 0.003, closed=True
    )
    return [prism(tool, 0.003).rotate((-turn, 0, 0)).translate((0.2 * wide, -0.9 * p.grip, end + 0.1 * tall))]


def hoop(centre: np.ndarray, radius: float, wire: float, width: float) -> Manifold:
    """A ring around (y, z) in the plane of the blade."""
    circle = superellipse(2, 2, 2, 64)
    return prism(centre + (radius + wire / 2) * circle, width, 0.2 * min(wire, width)) - prism(
        centre + (radius - wire / 2) * circle, 2 * width
    )
