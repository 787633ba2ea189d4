"""Shading: error of readings from finite differences relative to true normals, against time."""

from collections.abc import Callable, Iterable
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy import integrate, interpolate, ndimage, signal

from palpate.touch.sensor import PIXEL, PIXEL_CENTRES, SENSOR_RANGE, SENSOR_WIDTH
from palpate.touch.shading import DIFFUSE, LIGHTS, impression, lit, normals
from palpate.touch.sphere_tracing import TOLERANCE
from studies.error_vs_runtime.study import Method, Study

PRESSES = 8  # of each shape
MAX_IMPRESSION = 0.006  # m, depth of an impression; the least is a sixth of it
# Pixels nearer than this to another piece of surface are at an edge: the reach of the widest stencil.
EDGE_PIXELS = 3
TRACING_STEPS = 200  # of sphere tracing: more than any of its rays takes

# Weights of the pixels to the right, times the pixel's width; those to the left have the opposite sign.
STENCILS = {2: (1 / 2,), 4: (2 / 3, -1 / 12), 6: (3 / 4, -3 / 20, 1 / 60)}

Y, Z = np.meshgrid(PIXEL_CENTRES, PIXEL_CENTRES)
Slopes = Callable[[np.ndarray, int], np.ndarray]  # of impressions along an axis


class Press(NamedTuple):
    """Surfaces pressed into the gel, k of them.

    depth: (k, 100, 100) float32, depth maps. normal: (k, 100, 100, 3), true. reading: (k, 100, 100, 3) grey levels
    of the true normal, not rounded. inside: (k, 100, 100) bool, away from edges.
    """

    depth: np.ndarray
    normal: np.ndarray
    reading: np.ndarray
    inside: np.ndarray


class Shading(Study):
    """Finite differences of several orders, smoothed and limited ones, and splines.

    Rounding to whole grey levels alone is an error of 0.25 on average and 0.5 at worst. The `worst` error is at an
    edge, where the true normal jumps and a difference uses pixels of both sides.

    `height` is the error of the impression that results from integrating the slopes along each row of pixels. It
    shows how well the surface can be reconstructed from its reading. Limited differences are nearest to the true
    normals at edges, but lose steps: the normals beside a vertical wall don't show it.
    """

    stage = "shading"
    units = {
        "mean": "grey levels",
        "worst away from edges": "grey levels",
        "worst": "grey levels",
        "normal": "degrees",
        "height": "mm",
    }
    reference = "normals and shading of spheres, cylinders, planes and steps in closed form, double precision"

    def cases(self) -> Iterable[tuple[str, Press]]:
        random = np.random.default_rng(0)
        shapes = {f"sphere {1e3 * radius:g} mm": partial(_sphere, radius) for radius in (0.003, 0.01, 0.03)}
        shapes |= {f"cylinder {1e3 * radius:g} mm": partial(_cylinder, radius) for radius in (0.005, 0.02)}
        shapes |= {"plane": _plane, "step": _step, "sphere 10 mm, sphere-traced": partial(_traced_sphere, 0.01)}
        return ((name, press(shape, random)) for name, shape in shapes.items())

    def methods(self) -> list[Method]:
        """The library's differences are second-order, first-order at the border, in single precision."""
        of = _reading_from_slopes
        own, double = (_reading_from_normals(each) for each in (normals, _in_double_precision))
        rows = [
            ("central differences", "order", {2: own, 4: of(partial(_central, 4)), 6: of(partial(_central, 6))}),
            ("central differences", "order at the border", {1: own, 2: of(_gradient)}),
            ("central differences", "precision", {"float32": own, "float64": double}),
            ("one-sided differences", "order", {1: of(_one_sided)}),
            ("limited differences", "order", {1: of(_minmod), 2: of(_van_leer)}),
            ("Sobel", "pixels", {3: of(_sobel)}),
            ("Savitzky-Golay, parabola", "pixels", {n: of(partial(_parabola, n)) for n in (5, 7)}),
            ("spline", "degree", {n: of(partial(_spline, n)) for n in (3, 5)}),
        ]
        return [Method(name, knob, value, run, run is own) for name, knob, runs in rows for value, run in runs.items()]

    def errors(self, case: Press, result: tuple[np.ndarray, np.ndarray]) -> dict[str, float]:
        normal, reading = result
        off = np.abs(reading - case.reading)
        sine = np.linalg.norm(np.cross(normal, case.normal), axis=-1)
        angle = np.arctan2(sine, np.einsum("...i,...i->...", normal, case.normal))
        return {
            "mean": float(off.mean()),
            "worst away from edges": float(off[case.inside].max()),
            "worst": float(off.max()),
            "normal": float(np.degrees(angle).mean()),
            "height": 1e3 * _height_error(case, normal),
        }


def _height_error(case: Press, normal: np.ndarray) -> float:
    """Mean difference (m) of the slopes' integral along the rows (trapezoidal rule) and the impression's height."""
    slope = -normal[..., 0].astype(np.float64) / normal[..., 2]
    height = impression(case.depth.astype(np.float64))
    rise = integrate.cumulative_trapezoid(slope, dx=PIXEL, axis=-1, initial=0)
    return float(np.abs(rise - (height - height[..., :1])).mean())


def _reading_from_normals(normals_of: Callable[[np.ndarray], np.ndarray]) -> Callable[[Press], tuple]:
    def run(case: Press) -> tuple[np.ndarray, np.ndarray]:
        height = impression(case.depth)
        normal = normals_of(height)
        return normal, lit(height, normal)

    return run


def _reading_from_slopes(slopes: Slopes) -> Callable[[Press], tuple]:
    def normals_of(height: np.ndarray) -> np.ndarray:
        return _normals(slopes(height, -1), slopes(height, -2))

    return _reading_from_normals(normals_of)


def _normals(along_columns: np.ndarray, along_rows: np.ndarray) -> np.ndarray:
    length = np.sqrt(along_columns**2 + along_rows**2 + 1)
    return np.stack([-along_columns / length, -along_rows / length, 1 / length], axis=-1)


def _in_double_precision(height: np.ndarray) -> np.ndarray:
    along_rows, along_columns = np.gradient(height.astype(np.float64), PIXEL, axis=(-2, -1))
    return _normals(along_columns, along_rows)


def _gradient(height: np.ndarray, axis: int) -> np.ndarray:
    return np.gradient(height, np.float32(PIXEL), axis=axis, edge_order=2)


def _central(order: int, height: np.ndarray, axis: int) -> np.ndarray:
    """Central differences; of second order where the stencil doesn't fit, at the border."""
    right = np.array(STENCILS[order], dtype=np.float32) / np.float32(PIXEL)
    slope = ndimage.correlate1d(height, np.concatenate([-right[::-1], [0], right]), axis)
    border = np.moveaxis(slope, axis, -1)
    fallback = np.moveaxis(_gradient(height, axis), axis, -1)
    for side in (np.s_[..., : len(right)], np.s_[..., -len(right) :]):
        border[side] = fallback[side]
    return slope


def _one_sided(height: np.ndarray, axis: int) -> np.ndarray:
    """Differences to the next pixel; at the last pixel, to the one before."""
    return _sides(height, axis)[1]


def _minmod(height: np.ndarray, axis: int) -> np.ndarray:
    """The less steep of the two one-sided differences, which does not reach across a jump."""
    before, after = _sides(height, axis)
    return np.where(np.abs(before) < np.abs(after), before, after)


def _van_leer(height: np.ndarray, axis: int) -> np.ndarray:
    """The central difference, but at most twice as steep as the less steep side (van Leer 1977)."""
    before, after = _sides(height, axis)
    middle = (before + after) / 2
    limit = 2 * np.minimum(np.abs(before), np.abs(after))
    return np.clip(middle, -limit, limit)


def _sides(height: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Differences to the pixel before and to the one after; at the border both to the only neighbour."""
    step = np.diff(height, axis=axis) / np.float32(PIXEL)
    first, last = np.take(step, [0], axis), np.take(step, [-1], axis)
    return np.concatenate([first, step], axis), np.concatenate([step, last], axis)


def _sobel(height: np.ndarray, axis: int) -> np.ndarray:
    """Second-order differences, averaged with weights 1, 2, 1 over the rows or columns beside."""
    beside = -3 - axis
    return ndimage.correlate1d(_gradient(height, axis), [0.25, 0.5, 0.25], beside, mode="nearest")


def _parabola(pixels: int, height: np.ndarray, axis: int) -> np.ndarray:
    return signal.savgol_filter(height, pixels, 2, deriv=1, delta=PIXEL, axis=axis)


def _spline(degree: int, height: np.ndarray, axis: int) -> np.ndarray:
    spline = interpolate.make_interp_spline(PIXEL_CENTRES, height, k=degree, axis=axis % height.ndim)
    return spline.derivative()(PIXEL_CENTRES)


class Surface(NamedTuple):
    """A surface over the pixels: (100, 100) each.

    height: above the undeformed gel (negative: not in contact). slope: (2, 100, 100), along y and z. piece: number
    of the smooth piece of each pixel. shortfall: by how much depth maps stop short of the surface.
    """

    height: np.ndarray
    slope: np.ndarray
    piece: np.ndarray
    shortfall: np.ndarray | float = 0.0


def press(shape: Callable[[np.random.Generator], Surface], random: np.random.Generator) -> Press:
    """A shape pressed at random places and depths."""
    surfaces = [shape(random) for _ in range(PRESSES)]
    exact = np.stack([SENSOR_RANGE - each.height for each in surfaces])
    in_contact = exact <= SENSOR_RANGE
    depth = np.stack([SENSOR_RANGE - each.height - each.shortfall for each in surfaces])
    slope = np.where(in_contact[:, None], np.stack([each.slope for each in surfaces]), 0)
    normal = _normals(slope[:, 0], slope[:, 1])
    piece = np.where(in_contact, np.stack([each.piece for each in surfaces]), -1)
    around = (1, 2 * EDGE_PIXELS + 1, 2 * EDGE_PIXELS + 1)
    inside = ndimage.minimum_filter(piece, around) == ndimage.maximum_filter(piece, around)
    reading = _true_reading(np.where(in_contact, SENSOR_RANGE - exact, 0), normal)
    return Press(np.where(depth <= SENSOR_RANGE, depth, np.inf).astype(np.float32), normal, reading, inside)


def _true_reading(height: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Grey levels of the supplement's equation, not rounded: (k, 100, 100, 3)."""
    place = np.stack(np.broadcast_arrays(Y, Z, height), axis=-1)
    towards = LIGHTS - place[..., None, :]
    towards /= np.linalg.norm(towards, axis=-1, keepdims=True)
    return DIFFUSE * np.maximum(np.einsum("...i,...li->...l", normal, towards), 0)


def _place(random: np.random.Generator) -> tuple[np.ndarray, np.ndarray, float]:
    """A random point near the sensor's centre (2,), direction (2,) and depth of the impression; metres."""
    angle = random.uniform(0, 2 * np.pi)
    centre = random.uniform(-SENSOR_WIDTH / 3, SENSOR_WIDTH / 3, 2)
    return centre, np.array([np.cos(angle), np.sin(angle)]), random.uniform(MAX_IMPRESSION / 6, MAX_IMPRESSION)


def _round_surface(across: np.ndarray, radius: float, depth: float) -> Surface:
    """A ball or a rod; across (2, 100, 100): vectors from its centre or axis. Its lower half touches the gel."""
    square = radius**2 - (across**2).sum(axis=0)
    hit = square > 0
    rise = np.sqrt(np.where(hit, square, 1))
    height = np.where(hit, depth - radius + rise, -np.inf)
    return Surface(height, np.where(hit, -across / rise, 0), hit.astype(int))


def _sphere(radius: float, random: np.random.Generator) -> Surface:
    (y, z), _, depth = _place(random)
    return _round_surface(np.stack([Y - y, Z - z]), radius * random.uniform(0.8, 1.2), depth)


def _traced_sphere(radius: float, random: np.random.Generator) -> Surface:
    """A sphere whose depth maps are sphere-traced: each ray stops within the tolerance of the surface."""
    (y, z), _, depth = _place(random)
    radius *= random.uniform(0.8, 1.2)
    ball = _round_surface(np.stack([Y - y, Z - z]), radius, depth)
    centre, reached = SENSOR_RANGE - depth + radius, np.zeros_like(Y)
    for _ in range(TRACING_STEPS):
        gap = np.hypot(np.hypot(Y - y, Z - z), centre - reached) - radius
        reached += np.where(gap > TOLERANCE, gap, 0)
    return ball._replace(shortfall=np.where(ball.piece, SENSOR_RANGE - ball.height - reached, 0))


def _cylinder(radius: float, random: np.random.Generator) -> Surface:
    """A cylinder whose axis is parallel to the gel."""
    (y, z), (u, v), depth = _place(random)
    off = (Y - y) * u + (Z - z) * v
    return _round_surface(np.stack([off * u, off * v]), radius * random.uniform(0.8, 1.2), depth)


def _plane(random: np.random.Generator) -> Surface:
    """A plane tilted by up to 60 degrees."""
    (y, z), (u, v), depth = _place(random)
    steep = np.tan(random.uniform(0, np.radians(60)))
    slope = steep * np.array([u, v])[:, None, None] * np.ones_like(Y)
    return Surface(depth + steep * ((Y - y) * u + (Z - z) * v), slope, np.zeros(Y.shape, dtype=int))


def _step(random: np.random.Generator) -> Surface:
    """Two levels with a vertical wall between them."""
    (y, z), (u, v), depth = _place(random)
    up = (Y - y) * u + (Z - z) * v > 0
    low = random.uniform(0, depth)
    return Surface(np.where(up, depth, low), np.zeros((2, *Y.shape)), up.astype(int))


study = Shading
