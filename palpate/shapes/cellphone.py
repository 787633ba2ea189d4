"""Cellphones: panels with screens and keys, alone or joined by a hinge or slide; antennas, bumpers, cameras. Metres; a
phone stands upright along z, its screen faces +x, its middle is near the origin."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
from manifold3d import Manifold
from numpy.random import Generator
from numpy.typing import ArrayLike

from palpate.camera import rotation_about
from palpate.shapes.materials import Material, Part, choose, interface
from palpate.shapes.solids import box, cut, filleted, lathe, rod, slab, turned, union

AXES = (2, 0)
Size = tuple[float, float, float]  # thickness, width and height, m
PROUD, DEEP = 0.0002, 0.0012  # m that glass and keys stand off the shell, and are let into it


def build(p: SimpleNamespace, rng: Generator) -> list[Part]:
    """One panel, or two and what joins them."""
    height, width, thickness = p.height, p.width * p.height, p.thickness * p.height
    look = choose(rng, "shell", metallic=rng.choice([0.0, 0.0, 0.6]), roughness=rng.uniform(0.25, 0.5))
    if p.joint == "none":
        parts = front(p, rng, (thickness, width, height), look, screen=True, keys=True)
        return [*parts, *back(p, rng, thickness, width, height), *trim(p, rng, (thickness, width, height), look)]
    upper, lower = p.lid * thickness, (1 - p.lid) * thickness
    other = Material("second-shell", choose(rng, "shell").colour, 0.2, 0.4)
    book = p.joint == "book"
    lid_height = (0.82 if p.joint == "swivel" else 1) * height
    lid = front(p, rng, (upper, width, lid_height), look, screen=True, keys=False)
    lid = [*lid, *back(p, rng, upper, width, lid_height)]
    base = front(p, rng, (lower, width, height), other, screen=book, keys=not book, glass="inner")
    base += trim(p, rng, (lower, width, height), other)
    if p.joint == "flip":
        # Closed below a quarter; else open by 127 to 178 degrees: both faces look to +x and the hinge lies between.
        turn = 180 if p.opening < 0.25 else (1 - p.opening) / 0.75 * 51 + 2
        radius = rng.uniform(0.35, 0.5) * thickness
        join = rod((0, -0.46 * width, 0), (0, 0.46 * width, 0), radius, segments=56)
        base = moved(base, np.eye(3), (-lower / 2, 0, -height / 2 - 0.5 * radius))
        rotation = rotation_about(1, np.radians(turn))
        lid = moved(lid, rotation, rotation @ (-upper / 2 - 0.0006, 0, height / 2 + 0.5 * radius))
        return [*lid, *base, Part(join, Material("hinge", tuple(int(0.8 * c) for c in look.colour), 0.3, 0.4))]
    if book:
        # Hinged along z, open by 100 to 180 degrees, the screens inside.
        turn = np.radians((1 - p.opening) / 0.65 * 35)
        join = rod((0, 0, -0.47 * height), (0, 0, 0.47 * height), 0.42 * thickness, segments=48)
        left, right = rotation_about(2, turn), rotation_about(2, -turn)
        lid = moved(lid, left, left @ (0, 0.505 * width, 0))
        base = moved(base, right, right @ (0, -0.505 * width, 0))
        return [*lid, *base, Part(join, Material("hinge", (90, 92, 98), 0.8, 0.3))]
    if p.joint == "slide":
        shift = 0.5 * p.opening * height
        rail = box((0.3 * lower, 0.6 * width, 0.8 * height), (lower / 2, 0, -shift / 2))
        base = moved(base, np.eye(3), (0, 0, -shift / 2))
        lid = moved(lid, np.eye(3), (thickness / 2 + 0.0003, 0, shift / 2))
        return [*lid, *base, Part(rail, Material("rail", (60, 60, 64), 0.6, 0.4))]
    pivot, turn = np.array([0, 0, (height - width) / 2]), np.radians(100 * p.opening)
    rotation = rotation_about(0, turn)
    pin = rod((0, 0, pivot[2]), (thickness / 2 + 0.001, 0, pivot[2]), 0.25 * width, segments=48)
    lid = moved(lid, rotation, pivot + rotation @ (0, 0, 0.09 * height - pivot[2]) + (thickness / 2 + 0.0008, 0, 0))
    return [*lid, *base, Part(pin, Material("hinge", (60, 60, 64), 0.6, 0.4))]


def moved(parts: list[Part], rotation: np.ndarray, shift: ArrayLike) -> list[Part]:
    """Parts turned by a matrix (3, 3), then shifted (3,); pictures move with them."""
    frame = np.column_stack([rotation, shift])

    def uv(part: Part) -> Callable[[np.ndarray], np.ndarray]:
        return lambda vertices: part.uv((vertices - shift) @ rotation)

    return [Part(part.solid.transform(frame), part.material, uv(part)) for part in parts]


def front(
    p: SimpleNamespace, rng: Generator, size: Size, look: Material, screen: bool, keys: bool, glass: str = "black-glass"
) -> list[Part]:
    """A panel of size (thickness, width, height) around the origin, with a screen or keys or both on its +x face."""
    thickness, width, height = size
    face, margin = thickness / 2, p.bezel * width
    inner, top = width - 2 * margin, height / 2 - max(margin, 0.03 * height)
    holes = [box((min(0.3 * thickness, 0.0026), 0.14 * width, 0.006), (0, 0, -height / 2))]
    whole = screen and p.screen > 0.8  # glass from edge to edge
    if screen and not whole:
        top -= 0.02 * height
        holes += [plate(face, 0, top + (0.01 - 0.014 * k) * height, 0.25 * width, 0.006 * height) for k in (0, 1)]
    corner = (p.corner if p.bumper == "none" else min(p.corner, 0.2)) * width
    body = cut(slab(size, corner, min(p.edge * thickness, margin + 0.03 * width)), holes)
    parts, key_solids = [Part(body, look)], []
    if screen:
        tall = (1 if whole else p.screen if keys and p.keys != "none" else max(p.screen, 0.7)) * height
        tall = min(tall, top + height / 2 - max(margin, 0.03 * height))
        place = top - tall / 2
        if whole:
            pane = plate(face, 0, 0, width - 1.2 * margin, height - 1.2 * margin, max(corner - 0.6 * margin, 0.001))
        else:
            pane = plate(face, 0, place, inner, tall, 0.06 * width)
        parts.append(Part(pane, Material(glass, (14, 14, 18), 0, 0.08)))
        wide, high = inner - 0.04 * width, tall - 0.04 * width
        name = "screen" if glass == "black-glass" else "inner-screen"
        picture = replace(interface(rng, high / wide, p.old == "yes"), name=name)
        rounding = max(corner - margin, 0.02 * width) if whole else 0.02 * width
        parts.append(Part(plate(face + PROUD, 0, place, wide, high, rounding, 1.5 * PROUD), picture))
        top = place - tall / 2 - 0.02 * height
    low = -height / 2 + max(margin, 0.04 * height)
    if keys and p.keys != "none" and top - low > 0.06 * height:
        if p.keys == "home":
            middle = (top + low) / 2
            key_solids.append(disc(face, 0, middle, min(0.09 * width, 0.45 * (top - low)), 1, 0.5 * p.key_out))
        else:
            if p.navigation != "none" and top - low > 0.3 * height:
                tall = 0.22 * (top - low)
                key_solids += navigation(p, face, top - tall / 2, inner, tall)
                top -= 1.15 * tall
            rows, columns = (4, 3) if p.keys == "pad" else (4, 10)
            low = max(low, top - 0.85 * rows * inner / columns)
            pitch_y, pitch_z = inner / columns, (top - low) / rows
            wide, tall, cells = (1 - p.key_gap) * pitch_y, (1 - p.key_gap) * pitch_z, np.ndindex(rows, columns)
            spots = [((c + 0.5) * pitch_y - inner / 2, low + (r + 0.5) * pitch_z) for r, c in cells]
            key_solids += [plate(face, y, z, wide, tall, p.key_round * min(wide, tall), p.key_out) for y, z in spots]
    if key_solids:
        parts.append(Part(union(key_solids), Material("keys", choose(rng, "shell").colour, 0, 0.4)))
    return parts


def disc(x: float, y: float, z: float, radius: float, towards: float, height: float) -> Manifold:
    """A button or lens on the face at x, standing out along x by `height` (towards = 1 front, -1 back)."""
    profile = filleted([(radius, -0.0015), (radius, height), (0, height)], 0.4 * min(height, radius))
    return turned(profile, (x, y, z), (towards, 0, 0), 48)


def plate(
    x: float, y: float, z: float, width: float, height: float, corner: float = 0.0004, out: float = PROUD
) -> Manifold:
    """A rounded plate let into the face at x and standing out by `out`."""
    corner = min(corner, 0.49 * width, 0.49 * height)
    return slab((DEEP + out, width, height), corner, min(0.0004, 0.4 * out), (x + (out - DEEP) / 2, y, z))


def navigation(p: SimpleNamespace, face: float, z: float, width: float, tall: float) -> list[Manifold]:
    """A direction pad with its middle key, and soft keys beside it."""
    radius = min(0.5 * tall, 0.2 * width)
    if p.navigation == "round":
        pad = [disc(face, 0, z, radius, 1, p.key_out) - disc(face + 0.0015, 0, z, 0.6 * radius, 1, p.key_out)]
        pad.append(disc(face, 0, z, 0.45 * radius, 1, p.key_out))
    else:
        pad = [plate(face, 0, z, 2.2 * radius, 1.8 * radius, 0.4 * radius, p.key_out)]
    return [*pad, *(plate(face, s * 0.36 * width, z, 0.22 * width, radius, 0.3 * radius, p.key_out) for s in (-1, 1))]


def back(p: SimpleNamespace, rng: Generator, thickness: float, width: float, height: float) -> list[Part]:
    """Camera and battery on a panel's -x face."""
    face, lens, rise = -thickness / 2, p.lens * width, p.rise * width
    parts = []
    if p.hump > 0.05:
        deep = p.hump * p.thickness * p.height
        size = (deep + 0.3 * thickness, 0.86 * width, p.hump_height * height)
        place = (face - deep / 2 + 0.15 * thickness, 0, -0.5 * height + 0.5 * size[2] + 0.03 * height)
        hump = slab(size, 0.12 * width, 0.3 * deep, place)
        parts.append(Part(hump, Material("battery", choose(rng, "shell").colour, 0, 0.6)))
        rise = max(rise, 0.5 * deep) if p.hump_height > 0.75 else rise
    if p.camera == "none":
        return parts
    side, top = rng.uniform(-0.3, 0.3) * width, 0.5 * height - rng.uniform(2.6, 3.4) * lens
    islands = {"square": (4.6, 4.6), "pill": (2.6, 6.6), "bar": (0.94 * width / lens, 2.8), "disc": (6, 6)}
    places: dict[str, list[tuple[float, float]]] = {
        "single": [(0, 0)], "square": [(-1.1, 1.1), (-1.1, -1.1), (1.1, 0)], "pill": [(0, 2), (0, 0), (0, -2)],
        "bar": [(-2.4, 0), (0, 0), (2, 0)], "disc": [(1.3, 1.3), (1.3, -1.3), (-1.3, 1.3), (-1.3, -1.3)],
        "lenses": [(0, 1), (0, -1.4)],
    }  # fmt: skip
    spots = places[p.camera]
    wide, tall = islands.get(p.camera, (2.6, 2.6))
    side = 0 if p.camera == "bar" else np.clip(side, -0.47 * width + wide * lens / 2, 0.47 * width - wide * lens / 2)
    top = min(top, 0.48 * height - tall * lens / 2)
    if p.camera in islands:
        size, place = (0.002 + rise, wide * lens, tall * lens), (face - (rise - 0.002) / 2, side, top)
        island = slab(size, 0.3 * min(wide, tall) * lens, 0.4 * rise, place)
        parts.append(Part(island, Material("island", choose(rng, "shell").colour, 0.3, 0.3)))
    else:
        rims = [disc(face, side + y * lens, top + z * lens, 1.2 * lens, -1, rise) for y, z in spots]
        parts.append(Part(union(rims), Material("island", (40, 40, 44), 0.5, 0.3)))
    lenses = [disc(face - rise, side + y * lens, top + z * lens, 0.85 * lens, -1, 0.0008) for y, z in spots]
    return [*parts, Part(union(lenses), Material("lens", (16, 18, 30), 0.2, 0.05))]


def trim(p: SimpleNamespace, rng: Generator, size: Size, look: Material) -> list[Part]:
    """Side buttons, antenna and bumpers of a panel."""
    thickness, width, height = size
    share, tall = rng.uniform(-0.1, 0.35, 3) * height, rng.uniform(0.05, 0.13, 3) * height
    sides = zip(rng.choice([-1, 1], 3), share, tall, strict=True)
    edge = 0.5 * width - 0.0009
    buttons = [slab((0.35 * thickness, 0.003, t), 0.001, 0.0004, (0, s * edge, z)) for s, z, t in sides]
    parts = [Part(union(buttons), choose(rng, "metal", ["steel", "aluminium"]))]
    if p.antenna != "none":
        radius = min(p.antenna_width * width, 0.45 * thickness)
        length = p.antenna_length * height * (0.4 if p.antenna == "stub" else 1)
        thin = radius * (0.85 if p.antenna == "stub" else 0.5)
        steps = [(radius, -0.06 * height), (radius, 0.35 * length), (thin, 0.5 * length), (thin, length), (0, length)]
        y = (0.5 * width - 1.3 * radius - p.corner * width * 0.3) * p.antenna_side / 0.42
        stick = lathe(filleted(steps, 0.3 * thin), 48).translate((-0.02 * thickness, y, height / 2))
        parts.append(Part(stick, Material("rubber", (30, 30, 32), 0, 0.8)))
    if p.bumper == "none":
        return parts
    out = p.bumper_out * width
    hollow = slab((2 * thickness, 0.9 * width, 0.94 * height), 0.05 * width, 0.0001)
    if p.bumper == "corners":
        arm = rng.uniform(0.2, 0.4) * width
        block = slab((thickness + out, arm, arm * rng.uniform(0.8, 1.5)), 0.3 * arm, 0.3 * out)
        y, z = 0.5 * (width - arm) + out / 2, 0.5 * (height - arm) + out / 2
        guards = union([block.translate((0, side * y, end * z)) for side in (-1, 1) for end in (-1, 1)])
    else:
        count, ridge = int(rng.integers(4, 12)), slab((0.9 * thickness, out, 0.6 * height), 0.3 * out, 0.25 * out)
        notch = rod((0, 0, 0), (0, out, 0), 0.4 * out, segments=20).scale((3, 1, 1))
        ridge = cut(ridge, [notch.translate((0, 0, z)) for z in np.linspace(-0.25, 0.25, count) * height])
        guards = union([ridge.translate((0, side * width / 2, 0)) for side in (-1, 1)])
    names = ["yellow-plastic", "orange-plastic", "black-plastic", "red-plastic"]
    return [*parts, Part(guards - hollow, choose(rng, "plastic", names, roughness=0.7))]
