"""An elastic gel: a layer of finite thickness, bonded to a rigid base, that a rigid surface is pressed into.

Linear elasticity in closed form. The response is a product in the plane of wavenumbers, so a contact takes Fourier
transforms only. Pressures are constant on pixels, and displacements are means over pixels. Images are (rows, columns);
vectors have y (along the columns) first and z (along the rows) second, as the sensor's frame.

Omitted: the gel's edge (the layer goes on around the face), finite strain, the bending of the normal motion by
sideways tractions, adhesion. `studies` has what they would change: docs/gel.md.
"""

from collections.abc import Callable
from functools import cached_property, lru_cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike
from scipy import fft

PADDING = 3.0  # thicknesses around an image, beyond which the layer hardly moves
ALIASES = 2  # wavenumbers beyond the grid's that are summed, each way: pressures have edges at those of pixels
TOLERANCE = 1e-3  # of gaps and penetration, in units of the approach
ITERATIONS = 1000
MARGIN = 2  # pixels around where a contact is expected, in which it is solved at first
Axes = tuple[int, ...]
_SERIES = 0.1  # below it sinh y - y is summed by its series: the difference has no digits left


class Layer(NamedTuple):
    """A gel's material and thickness."""

    thickness: float  # m
    shear_modulus: float  # Pa
    poisson: float  # Poisson's ratio, 0 to 0.5, both included


class Response(NamedTuple):
    """What a traction of one wavenumber k does to the face, m / Pa: real amplitudes, all along or across k."""

    normal: np.ndarray  # motion into the gel by pressure
    along: np.ndarray  # motion along k by traction along k
    across: np.ndarray  # motion across k by traction across k, in the face
    spread: np.ndarray  # motion along k by pressure, -i times: away from pressure if positive


class Pressed(NamedTuple):
    """A rigid surface at rest in the gel; images are those of the surface that was given."""

    indentation: np.ndarray  # (r, c) m, of the face into the gel; negative where it bulges
    pressure: np.ndarray  # (r, c) Pa, the mean on each pixel
    displacement: np.ndarray  # (r, c, 2) m, of the face sideways: y, z
    traction: np.ndarray  # (r, c, 2) Pa, of the surface on the face by friction: y, z; 0 without a slide or twist
    approach: float  # m, of the surface from its first touch
    strain: float  # approach / thickness


class NotConverged(ArithmeticError):
    """The contact's conjugate gradients did not meet their stop test."""


def response(wavenumber: np.ndarray, layer: Layer) -> Response:
    """Responses (...) of the face to tractions of wavenumbers (...), rad/m; at 0 those to a uniform traction. From the
    plane-strain solution of a layer that is bonded to a rigid base. All terms are divided by exp(2 k h)."""
    thickness, modulus, poisson = layer
    x = np.maximum(np.asarray(wavenumber) * thickness, 1e-9)  # the limit at 0, to rounding
    kolosov, decay = 3 - 4 * poisson, np.exp(-2 * x)
    y = np.minimum(2 * x, _SERIES)
    series = y**3 / 6 * (1 + y**2 / 20 * (1 + y**2 / 42 * (1 + y**2 / 72)))
    sinh = -np.expm1(-4 * x) / 2
    sinh_less = np.where(2 * x < _SERIES, series * decay, sinh - 2 * x * decay)  # sinh 2x - 2x
    cosh_less = np.expm1(-2 * x) ** 2 / 2  # cosh 2x - 1
    scale = thickness / (modulus * x)
    denominator = 2 * kolosov * (cosh_less + decay) + (4 * x**2 + 1 + kolosov**2) * decay
    upright = 2 * kolosov * sinh_less + 8 * (1 - 2 * poisson) * x * decay  # 2 K sinh 2x - 4x
    return Response(
        normal=scale * (1 - poisson) * upright / denominator,
        along=scale * (1 - poisson) * (2 * kolosov * sinh + 4 * x * decay) / denominator,
        across=scale * np.tanh(x),
        spread=scale * (4 * x**2 * decay - kolosov * (kolosov - 1) * cosh_less) / (2 * denominator),
    )


class Face:
    """How a layer's face moves on a grid of pixels; `face` keeps those of the last grids."""

    def __init__(
        self,
        layer: Layer,
        shape: tuple[int, int],
        pixel: tuple[float, float],
        dtype: DTypeLike = np.float64,
        padding: float = PADDING,
    ):
        """shape: rows and columns; pixel: edges along rows' and columns' direction, m. padding: thicknesses around."""
        self.layer, self.shape, self.pixel, self.dtype = layer, shape, pixel, dtype
        more = (int(np.ceil(n + padding * layer.thickness / edge)) for n, edge in zip(shape, pixel, strict=True))
        self.padded = tuple(fft.next_fast_len(n, real=True) for n in more)
        self._kernel = lru_cache(maxsize=64)(self._spectra)

    @cached_property
    def _around(self) -> np.ndarray:
        """(3, 3, R, C) m / Pa around one pixel: along y, z and into the gel, by tractions likewise. In wavenumbers
        responses times squares of sincs, since tractions are constant on pixels and displacements means over them."""
        total: Any = 0
        for order in product(range(-ALIASES, ALIASES + 1), repeat=2):
            cycles = np.fft.fftfreq(self.padded[0])[:, None] + order[0], np.fft.rfftfreq(self.padded[1]) + order[1]
            z, y = (2 * np.pi * n / edge for n, edge in zip(cycles, self.pixel, strict=True))
            wavenumber, mean = np.hypot(y, z), np.sinc(cycles[0]) ** 2 * np.sinc(cycles[1]) ** 2
            found, y, z = response(wavenumber, self.layer), *(k / np.maximum(wavenumber, 1e-30) for k in (y, z))
            more, nothing = found.along - found.across, 0 * wavenumber  # more is 0 at 0, where no direction is meant
            motions = [
                [found.across + more * y * y, more * y * z, -1j * found.spread * y],
                [more * y * z, found.across + more * z * z, -1j * found.spread * z],
                [nothing, nothing, found.normal],
            ]
            total = total + mean * np.array(motions)
        # By pressure sideways they are odd along their axes, so that nothing is left at the grid's largest wavenumber.
        if self.padded[0] % 2 == 0:
            total[1, 2, self.padded[0] // 2] = 0
        if self.padded[1] % 2 == 0:
            total[0, 2, :, -1] = 0
        return fft.irfft2(total, self.padded).astype(self.dtype)

    def _spectra(self, axes: tuple[Axes, Axes], shape: tuple[int, int]) -> tuple[list[int], np.ndarray]:
        """Size of transforms, and spectra (i, j, ...) of motions by tractions, for blocks of pixels of a shape."""
        size = [min(fft.next_fast_len(2 * n - 1, real=True), most) for n, most in zip(shape, self.padded, strict=True)]
        places = (np.rint(np.fft.fftfreq(n, 1 / n)).astype(int) for n in size)
        return size, fft.rfft2(self._around[np.ix_(*map(np.asarray, (*axes, *places)))])

    def moved(self, tractions: np.ndarray, motions: Axes = (0, 1, 2), by: Axes = (2,)) -> np.ndarray:
        """Motions (i, r, c), m, of a block of pixels by tractions (j, r, c), Pa, on it. Axes: along y, z, into the gel.
        As long transforms as the block needs: those of a small one are the whole face's, to rounding."""
        rows, columns = tractions.shape[1:]
        size, kernel = self._kernel((motions, by), (rows, columns))
        spectrum = fft.fft(fft.rfft(tractions, size[1]), size[0], axis=-2)
        spectrum = fft.ifft(np.einsum("ij...,j...->i...", kernel, spectrum), axis=-2)[:, :rows]  # others are not needed
        return fft.irfft(spectrum, size[1])[..., :columns]


face = lru_cache(maxsize=4)(Face)


def contact(
    moved: Callable[[np.ndarray], np.ndarray],
    gap: np.ndarray,
    start: np.ndarray,
    total: float | None = None,
    approach: float = 0.0,
    tolerance: float = TOLERANCE,
) -> tuple[np.ndarray, float]:
    """Pressures p >= 0 (r, c) with gaps moved(p) + gap - approach >= 0, one of the two 0 at each pixel; and the
    approach, m.

    Conjugate gradients of Polonsky and Keer (1999, Wear 231). moved: the face's motion by pressures, linear, symmetric
    and positive. gap: (r, c) before it, inf where there is no surface. start: (r, c) pressures to begin with, positive
    somewhere. total: of the pressures, which decides the approach; None: it is `approach`.

    The stop test has two parts, both in units of the approach: the deepest penetration, and the mean gap in contact,
    weighted by pressure. A contact of one pixel meets the second at once. Raises NotConverged.
    """
    pressure, way, before, tiny = start, np.zeros_like(start), 0.0, float(np.finfo(float).tiny)
    move = moved(pressure)
    for _ in range(ITERATIONS):
        touching = pressure > 0
        distance = move + gap
        if total is not None:
            approach = float(distance[touching].mean())
        distance -= approach
        inside = np.where(touching, distance, 0)
        off = float(np.vdot(pressure, np.abs(inside))) / max(float(pressure.sum()), tiny)
        if max(-distance.min(), off) <= tolerance * max(float((move * touching).max()), tiny):
            return pressure, approach
        square = float(np.vdot(inside, inside))
        way = inside + (square / before if before else 0.0) * way * touching
        answer = moved(way)
        work = float(np.vdot(answer, way))
        if total is not None:
            work -= float(answer[touching].mean()) * float(way.sum())
        if work > 0:
            step = float(np.vdot(inside, way)) / work
        else:  # a contact of one pixel has no direction: others are pressed by what would close the gap alone
            one = np.arange(way.size).reshape(way.shape) == np.argmax(touching)
            step = 1 / float(moved(one.astype(way.dtype))[one][0])
        stepped, outside = pressure - step * way, ~touching & (distance < 0)
        pressure = np.maximum(stepped, 0)
        pressure[outside] -= step * distance[outside]
        before = 0.0 if outside.any() else square
        scale = 1.0 if total is None else total / float(pressure.sum())
        changed = outside.any() or (stepped < 0).any()  # else the motion follows without another transform
        pressure *= scale
        move = moved(pressure) if changed else scale * (move - step * answer)
    raise NotConverged(f"the contact did not settle in {ITERATIONS} iterations: it penetrates by {-distance.min():g} m")


def indent(
    gel: Face, gap: np.ndarray, force: float | None = None, depth: float = 0.0, tolerance: float = TOLERANCE
) -> tuple[np.ndarray, np.ndarray, float]:
    """Pressures (r, c) Pa under a rigid surface, the motion of the face as `Face.moved`, and the approach, m.

    gap: (r, c) m before the face, 0 at the first touch, inf where there is no surface. force: N, which decides the
    approach; None: it is `depth`, more than the least gap. Raises NotConverged.
    """
    area, total = float(np.prod(gel.pixel)), None
    # To begin with: springs, as stiff as the layer is for a wavelength of the contact's size.
    if force is not None:
        total, order = force / area, np.sort(gap[np.isfinite(gap)])
        count = np.unique(np.geomspace(1, len(order), 200).astype(int))
        stiffness, below = 1 / response(np.pi / np.sqrt(count * area), gel.layer).normal, np.cumsum(order)[count - 1]
        last = int(np.flatnonzero(stiffness * (count * order[count - 1] - below) < total)[-1])
        depth = (total / stiffness[last] + below[last]) / count[last]
    pressure = np.maximum(depth - gap, 0)
    pressure /= response(np.pi / np.sqrt(np.count_nonzero(pressure) * area), gel.layer).normal
    if total is not None:
        pressure *= total / pressure.sum()
    touching = pressure > 0
    while True:  # in a block of pixels around the contact, until nothing beside it penetrates
        places = [np.flatnonzero(touching.any(axis=axis)) for axis in (1, 0)]
        block = tuple(slice(max(at[0] - MARGIN, 0), at[-1] + 1 + MARGIN) for at in places)
        start = pressure[block]
        pressed, approach = contact(
            lambda image: gel.moved(image[None], (2,))[0], gap[block], start, total, depth, tolerance
        )
        pressure = np.zeros_like(pressure)
        pressure[block] = pressed
        motion = gel.moved(pressure[None])
        beside = approach - gap - motion[2] > tolerance * motion[2].max()
        beside[block] = False
        if not beside.any():
            return pressure, motion, approach
        touching = (pressure > 0) | beside


def press(
    surface: np.ndarray,
    pixel: tuple[float, float],
    layer: Layer,
    force: float,
    slide: tuple[float, float] = (0.0, 0.0),
    twist: float = 0.0,
    friction: float = 0.5,
    tolerance: float = TOLERANCE,
    dtype: type = np.float64,
) -> Pressed:
    """Press a rigid surface into a gel with a stated force, then slide or twist it.

    surface: (r, c) m from the undeformed face outwards, along the sensor's axis; +inf where there is none. Only its
    shape counts: the force decides how far it goes in. pixel: edges along the rows' and columns' direction, m. force: N
    along the axis. slide: m of the surface along y and z; twist: rad about the axis through the centre of pressure,
    from y to z. friction: Coulomb's coefficient.

    Raises ValueError for a surface without a finite pixel or with NaN, a layer or a force that is not positive;
    NotConverged if the solver does not end.
    """
    surface = np.asarray(surface, dtype=dtype)
    lowest = surface.min()
    if not np.isfinite(lowest):
        raise ValueError("expected heights in metres, somewhere finite, +inf where nothing is; got none, NaN or -inf")
    if not (layer.thickness > 0 and layer.shear_modulus > 0 and 0 <= layer.poisson <= 0.5):
        raise ValueError(f"{layer}: expected thickness and shear modulus above 0, Poisson's ratio of 0 to 0.5")
    if not 0 < force < np.inf:
        raise ValueError(f"a force of {force} N: expected a positive number")
    gel = face(layer, surface.shape, tuple(pixel), dtype)
    pressure, motion, approach = indent(gel, surface - lowest, force, tolerance=tolerance)
    displacement, traction = motion[:2], np.zeros_like(motion[:2])
    if np.any(slide) or twist:
        # Coulomb friction, by a second solve of the same form (Ciavarella's and Jaeger's theorem): full slip, less a
        # correction q >= 0 that is 0 where the face slips. Tractions lie along the imposed motion at each pixel.
        places = (np.arange(n) * edge for n, edge in zip(gel.shape, gel.pixel, strict=True))
        z, y = (at - np.average(at, weights=pressure.sum(axis=1 - axis)) for axis, at in enumerate(places))
        imposed = np.stack(np.broadcast_arrays(slide[0] - twist * z[:, None], slide[1] + twist * y))
        length = np.linalg.norm(imposed, axis=0)
        along = imposed / np.maximum(length, np.finfo(float).tiny)

        def moved(traction: np.ndarray) -> np.ndarray:
            return (gel.moved(traction * along, (0, 1), (0, 1)) * along).sum(axis=0)

        slipping = friction * pressure
        gap = np.where(pressure > 0, length - moved(slipping), np.inf)
        correction = contact(moved, gap, slipping, tolerance=tolerance)[0] if friction > 0 else slipping
        traction = (slipping - np.minimum(correction, slipping)) * along
        displacement = displacement + gel.moved(traction, (0, 1), (0, 1))
    displacement, traction = (np.moveaxis(vectors, 0, -1) for vectors in (displacement, traction))
    return Pressed(motion[2], pressure, displacement, traction, approach, approach / layer.thickness)
