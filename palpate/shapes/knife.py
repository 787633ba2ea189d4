"""Knives: one blade of any outline, with teeth and holes; handles, guards and pommels; folding knives half open.
Metres; the long axis is y with the tip towards +y, the edge faces -z, the flat side faces +x. The blade begins at y =
0, its handle lies at y < 0 around z = 0."""

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
from manifold3d import Manifold
from numpy.random import Generator
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from palpate.shapes.materials import Material, Part, choose
from palpate.shapes.solids import along_y, bent_bar, box, cut, filleted, loft, prism, rod, superellipse, sweep, union

AXES = (1, 2)
# m. A sharp edge's thickness: what a whetted edge has is below what a mesh in float32 and a sensor can tell.
EDGE = 0.0004
POINT = 0.0012  # m, height of a blade at its very tip
Line = Callable[[ArrayLike], np.ndarray]  # heights z at shares of a length


def build(p: SimpleNamespace, rng: Generator) -> list[Part]:
    """Blade, handle, guard and pommel by the parameters."""
    tall, wide = p.tall * p.grip, p.wide * p.tall * p.grip
    cutting = blade(p)
    if p.fold > 0:
        pivot = np.array([0, -0.01, 0])
        cutting = cutting.translate(-pivot).rotate((p.fold, 0, 0)).translate(pivot)
    grip, centre = handle(p, tall, wide)
    at = np.linspace(0.12, 0.85, p.rivets) if p.rivets > 1 else np.full(p.rivets, 0.15)
    half = wide / 2 + 0.0003
    pins = [rod((-half, -s * p.grip, centre(s)), (half, -s * p.grip, centre(s)), 0.11 * tall, segments=28) for s in at]
    fittings = [*guard(p, tall, wide, centre), *pommel(p, rng, tall, wide, centre)]
    fittings, pins = ([solid.rotate((p.tilt, 0, 0)) for solid in solids] for solids in (fittings, pins))
    if p.fold > 0:  # the slot that the blade folds into
        grip -= box((p.thickness + 0.0008, 0.9 * p.grip, tall), (0, -0.45 * p.grip, 0.45 * tall))
    steel = choose(rng, "metal", ["steel"]) if rng.uniform() < 0.75 else choose(rng, "dark metal")
    parts = [Part(union([cutting, *pins]), steel), Part(grip.rotate((p.tilt, 0, 0)), choose(rng, p.grip_material))]
    if fittings:
        bright = choose(rng, "metal", ["brass", "steel", "copper"])
        parts.append(Part(union(fittings), Material("fittings", bright.colour, bright.metallic, bright.roughness)))
    return parts


def blade(p: SimpleNamespace) -> Manifold:
    """The blade, with what is cut into it, and a tang that reaches into the handle."""
    t = 1 - np.float_power(1 - np.linspace(0, 1, 90), 1.5)
    y, tallest = t * p.length, p.height * p.length
    grown = p.heel + (1 - p.heel) * np.clip(t / 0.2, 0, 1) ** 2 * (3 - 2 * np.clip(t / 0.2, 0, 1))
    full = tallest * grown * (1 + p.bulge * np.sin(np.pi * t) ** 2)
    middle = p.offset * tallest - p.droop * p.length * t**2
    drop = (1 - p.point) * np.float_power(np.clip((t - p.clip) / (1 - p.clip), 0, 1), p.clip_power)
    rise = p.point * np.float_power(np.clip((t - p.belly) / (1 - p.belly), 0, 1), p.belly_power)
    back = middle + full * (0.5 - (1 - p.blunt) * drop)
    edge = middle + full * (-0.5 + (1 - p.blunt) * rise + p.wave * np.sin(2 * np.pi * t) * (1 - t))
    # Where back and edge would meet or cross, the back stays above. Two edges are ground to both sides, as a dagger's.
    tall, double = np.maximum(back - edge, POINT), p.edges == "double"
    thick = np.minimum(p.thickness * (1 - 0.5 * t), tall)
    sharp = np.minimum(EDGE, thick)
    bevelled = edge + (0.5 if double else p.bevel) * tall
    upper = bevelled if double else edge + 0.96 * tall
    half = [(sharp / 2 if double else 0.94 * thick / 2, edge + tall), (thick / 2, upper)]
    half += [(thick / 2, bevelled - 1e-5), (sharp / 2, edge)]
    outline = [half[0], *((-x, z) for x, z in half), *half[:0:-1]]
    solid = loft(np.stack([np.stack([x, y, z], -1) for x, z in outline], axis=1))
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


def handle(p: SimpleNamespace, tall: float, wide: float) -> tuple[Manifold, Line]:
    """The handle behind y = 0, and its middle line: height z at a share of its length."""

    def centre(share: ArrayLike) -> np.ndarray:
        return -p.sag * p.grip * np.asarray(share) ** 2

    s, heights = np.linspace(0, 1, 100), [0.9 * p.neck, p.neck, p.palm, p.waist, p.butt, 0.75 * p.butt]
    size = PchipInterpolator([0, 0.1, 0.5, 0.75, 0.95, 1], heights)(s) * (1 + p.rings * np.cos(2 * np.pi * 9 * s))
    width = wide * (0.5 + 0.5 * size / size.max())
    stations = np.column_stack([-p.grip * s, centre(s) - size * tall / 2, centre(s) + size * tall / 2, width])
    return along_y(stations[::-1], p.squareness, 90, 80), centre


def guard(p: SimpleNamespace, tall: float, wide: float, centre: Line) -> list[Manifold]:
    """What is between handle and blade."""
    thick, reach = p.guard_thick * tall, p.reach * tall
    if p.guard == "none":
        return []
    if p.guard == "bolster":
        half = 0.52 * p.neck * tall
        stations = [(-thick, -half, half, wide), (0, -half, half, wide), (thick, -0.8 * half, 0.8 * half, 0.3 * wide)]
        return [along_y(stations, 3)]
    ahead = p.sweep * reach / 2
    path = [(0, ahead, reach / 2), (0, 0, 0.25 * reach), (0, 0, -0.25 * reach), (0, ahead, -reach / 2)]
    bar = bent_bar(path, 0.3 * reach, 1.05 * wide, thick, 3, 32)
    if p.guard == "cross":
        return [bar]
    low, end = -0.5 * reach, float(centre(1))
    path = [(0, 0, low), (0, -0.25 * p.grip, low - 0.3 * tall), (0, -0.8 * p.grip, low - 0.3 * tall), (0, -p.grip, end)]
    return [bar, bent_bar(path, 0.03, 0.7 * wide, 0.35 * thick, 2.5, 28)]


def pommel(p: SimpleNamespace, rng: Generator, tall: float, wide: float, centre: Line) -> list[Manifold]:
    """What is at the end of the handle."""
    size, end = p.pommel_size * tall / 2, float(centre(1))
    if p.pommel == "none" or (p.pommel == "tool" and p.fold == 0):
        return []
    if p.pommel == "ball":
        ball = Manifold.sphere(0.6 * size, 48).scale((min(1, wide / size), *rng.uniform(0.7, 1.3, 2)))
        return [ball.translate((0, -p.grip - 0.3 * size, end))]
    if p.pommel == "cap":
        back = -p.grip - rng.uniform(0.3, 0.9) * size
        ends = (back, end - 0.7 * size, end + 0.7 * size, 0.8 * wide), (-p.grip, end - size, end + size, 1.03 * wide)
        return [along_y(ends, 3, 12)]
    if p.pommel == "ring":
        middle, circle = np.array([-p.grip - 0.7 * size, end]), superellipse(2, 2, 2, 64)
        wire, width = 0.3 * size, 0.5 * wide
        disc = prism(middle + (0.9 * size + wire / 2) * circle, width, 0.2 * min(wire, width))
        return [disc - prism(middle + (0.9 * size - wire / 2) * circle, 2 * width)]
    blade_out, turn = rng.uniform(0.35, 0.8) * p.grip, rng.uniform(20, 75)
    tool = np.array([(0, 0.1), (-1, 0.06), (-1, -0.06), (0, -0.1)]) * blade_out
    tool = prism(filleted(tool, 0.003, closed=True), 0.003).rotate((-turn, 0, 0))
    return [tool.translate((0.2 * wide, -0.9 * p.grip, end + 0.1 * tall))]
