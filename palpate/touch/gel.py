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
from typing import NamedTuple

import numpy as np
from numpy.typing import DTypeLike
from scipy import fft

PADDING = 3.0  # thicknesses around an image, beyond which the layer hardly moves
ALIASES = 2  # wavenumbers beyond the grid's that are summed, each way: pressures have edges at those of pixels
TOLERANCE = 1e-3  # of gaps and penetration, in units of the approach
ITERATIONS = 1000
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
    force: float  # N, into the gel
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
    """The responses of a layer's face on a grid of pixels, each computed once; `face` keeps those of the last grids."""

    def __init__(
        self,
        layer: Layer,
        shape: tuple[int, int],
        pixel: tuple[float, float],
        dtype: DTypeLike = np.float64,
        padding: float = PADDING,
    ):
        """shape: rows and columns; pixel: edges along rows' and columns' direction, m. padding: thicknesses around."""
        self.layer, self.shape, self.pixel, self.dtype = layer, shape, pixel, np.dtype(dtype)
        more = (int(np.ceil(n + padding * layer.thickness / edge)) for n, edge in zip(shape, pixel, strict=True))
        self.padded = tuple(fft.next_fast_len(n, real=True) for n in more)

    def _kernel(self, parts: Callable[[Response, np.ndarray, np.ndarray], np.ndarray]) -> np.ndarray:
        """What `parts` makes of the response and the unit vector (y, z) of each wavenumber of the grid. Multiplied by
        squares of sincs, since tractions are constant on pixels and displacements means over them."""
        steps = [2 * np.pi / edge for edge in self.pixel]
        rows = np.fft.fftfreq(self.padded[0])[:, None] * steps[0]
        columns = np.fft.rfftfreq(self.padded[1])[None] * steps[1]
        total: np.ndarray = np.zeros(1)
        for order_z, order_y in product(range(-ALIASES, ALIASES + 1), repeat=2):
            z, y = rows + order_z * steps[0], columns + order_y * steps[1]
            wavenumber = np.hypot(y, z)
            mean = np.sinc(z / steps[0]) ** 2 * np.sinc(y / steps[1]) ** 2
            unit = np.maximum(wavenumber, 1e-30)
            total = total + mean * parts(response(wavenumber, self.layer), y / unit, z / unit)
        return total

    @cached_property
    def _normal(self) -> np.ndarray:
        return self._kernel(lambda found, y, z: found.normal).astype(self.dtype)

    @cached_property
    def _spread(self) -> np.ndarray:
        """(2, ...) of y and z, each odd along its axis, so that nothing is left at the grid's largest wavenumber."""
        kernel = self._kernel(lambda found, y, z: found.spread * np.stack([y, z]))
        if self.padded[0] % 2 == 0:
            kernel[1, self.padded[0] // 2] = 0
        if self.padded[1] % 2 == 0:
            kernel[0, :, -1] = 0
        return (-1j * kernel).astype(np.result_type(self.dtype, np.complex64))

    @cached_property
    def _shear(self) -> np.ndarray:
        """(3, ...) y by y, y by z (or z by y), z by z."""

        def parts(found: Response, y: np.ndarray, z: np.ndarray) -> np.ndarray:
            more = found.along - found.across  # 0 at 0, where no direction is meant
            return np.stack([found.across + more * y * y, more * y * z, found.across + more * z * z])

        return self._kernel(parts).astype(self.dtype)

    def _transform(self, image: np.ndarray) -> np.ndarray:
        """The spectrum (..., rows, columns / 2 + 1); as `rfft2`, without the transforms of rows of zeros."""
        return fft.fft(fft.rfft(image, self.padded[1], axis=-1), self.padded[0], axis=-2)

    def _image(self, spectrum: np.ndarray) -> np.ndarray:
        rows = fft.ifft(spectrum, axis=-2)[..., : self.shape[0], :]
        return fft.irfft(rows, self.padded[1], axis=-1)[..., : self.shape[1]]

    def indentation(self, pressure: np.ndarray) -> np.ndarray:
        """(r, c) m into the gel by pressures (r, c) Pa."""
        return self._image(self._normal * self._transform(pressure))

    def spread(self, pressure: np.ndarray) -> np.ndarray:
        """(r, c, 2) m sideways by pressures (r, c) Pa."""
        return np.moveaxis(self._image(self._spread * self._transform(pressure)), 0, -1)

    def shear(self, traction: np.ndarray) -> np.ndarray:
        """(r, c, 2) m sideways by sideways tractions (r, c, 2) Pa."""
        y, z = self._transform(np.moveaxis(traction, -1, 0))
        yy, yz, zz = self._shear
        return np.moveaxis(self._image(np.stack([yy * y + yz * z, yz * y + zz * z])), 0, -1)


face = lru_cache(maxsize=8)(Face)


def contact(
    moved: Callable[[np.ndarray], np.ndarray],
    gap: np.ndarray,
    total: float | None,
    start: np.ndarray,
    tolerance: float,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Pressures p >= 0 (r, c) with gaps moved(p) + gap - approach >= 0, one of the two 0 at each pixel; also moved(p),
    and the approach.

    Conjugate gradients of Polonsky and Keer (1999, Wear 231). moved: the face's motion by pressures, linear, symmetric
    and positive. gap: (r, c) before it, inf where there is no surface. total: of the pressures, which decides the
    approach; None: the approach is 0. start: (r, c) pressures to begin with, positive somewhere.

    The stop test has two parts, both in units of the approach: the deepest penetration, and the mean gap in contact,
    weighted by pressure. A contact of one pixel meets the second at once. Raises NotConverged.
    """
    allowed = np.isfinite(gap)
    gap, tiny = np.where(allowed, gap, 0), float(np.finfo(float).tiny)
    pressure, way, before, approach = start, np.zeros_like(start), 0.0, 0.0
    move = moved(pressure)
    for _ in range(ITERATIONS):
        touching = pressure > 0
        distance = move + gap
        if total is not None:
            approach = float(distance[touching].mean())
            distance = distance - approach
        inside = distance * touching
        deepest = -float(distance[allowed].min())
        weighted = float((pressure * np.abs(inside)).sum()) / max(float(pressure.sum()), tiny)
        if max(deepest, weighted) <= tolerance * max(float((move * touching).max()), tiny):
            return pressure, move, approach
        outside = allowed & ~touching & (distance < 0)
        square = float((inside**2).sum())
        way = inside + (square / before if before else 0.0) * way * touching
        answer = moved(way)
        work = float((answer * way).sum())
        if total is not None:
            work -= float(answer[touching].mean()) * float(way.sum())
        # A contact of one pixel has no direction: its neighbours are pressed by what would close the gap alone.
        if work > 0:
            step = float((inside * way).sum()) / work
        else:
            one = np.zeros(touching.shape)
            one.flat[np.argmax(touching)] = 1
            step = 1 / float(moved(one).flat[np.argmax(touching)])
        stepped = pressure - step * way
        pressure = np.maximum(stepped, 0)
        pressure[outside] -= step * distance[outside]
        before = 0.0 if outside.any() else square
        scale = 1.0 if total is None else total / float(pressure.sum())
        changed = outside.any() or (stepped < 0).any()  # else the motion follows without another transform
        pressure *= scale
        move = moved(pressure) if changed else scale * (move - step * answer)
    raise NotConverged(f"the contact did not settle in {ITERATIONS} iterations: {deepest:g} m of penetration are left")


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
    allowed = np.isfinite(surface)
    if not (surface > -np.inf).all() or not allowed.any():
        raise ValueError("expected heights in metres, somewhere finite, +inf where nothing is; got none, NaN or -inf")
    if not (layer.thickness > 0 and layer.shear_modulus > 0 and 0 <= layer.poisson <= 0.5):
        raise ValueError(f"{layer}: expected thickness and shear modulus above 0, Poisson's ratio of 0 to 0.5")
    if not 0 < force < np.inf:
        raise ValueError(f"a force of {force} N: expected a positive number")
    gel, area = face(layer, surface.shape, tuple(pixel), dtype), pixel[0] * pixel[1]
    gap = surface - surface[allowed].min()
    # To begin with: springs, as stiff as the layer is for a wavelength of the contact's size.
    order = np.sort(gap[allowed], axis=None)
    count, below = np.arange(1, len(order) + 1), np.cumsum(order)
    stiffness = 1 / response(np.pi / np.sqrt(count * area), layer).normal
    last = int(np.flatnonzero(stiffness * (count * order - below) < force / area)[-1])
    start = np.maximum((force / area / stiffness[last] + below[last]) / count[last] - gap, 0)  # also where gap is inf
    start = start * (force / area / start.sum())
    pressure, indentation, approach = contact(gel.indentation, gap, force / area, start, tolerance)
    displacement = gel.spread(pressure)
    traction: np.ndarray = np.zeros((*surface.shape, 2), dtype)
    if np.any(slide) or twist:
        # Coulomb friction, by a second solve of the same form (Ciavarella's and Jaeger's theorem): full slip, less a
        # correction q >= 0 that is 0 where the face slips. Tractions lie along the imposed motion at each pixel.
        rows, columns = (np.arange(n) * edge for n, edge in zip(gel.shape, gel.pixel, strict=True))
        z = rows[:, None] - (pressure.sum(axis=1) @ rows) / pressure.sum()
        y = columns[None] - (pressure.sum(axis=0) @ columns) / pressure.sum()
        to_y, to_z = np.asarray(slide, dtype)
        imposed = np.stack(np.broadcast_arrays(to_y - twist * z, to_z + twist * y), axis=-1)
        length = np.linalg.norm(imposed, axis=-1)
        along = imposed / np.maximum(length, np.finfo(float).tiny)[..., None]

        def moved(traction: np.ndarray) -> np.ndarray:
            return (gel.shear(traction[..., None] * along) * along).sum(axis=-1)

        slipping = friction * pressure
        gap = np.where(pressure > 0, length - moved(slipping), np.inf)
        correction = contact(moved, gap, None, slipping, tolerance)[0] if friction > 0 else slipping
        traction = (slipping - np.minimum(correction, slipping))[..., None] * along
        displacement = displacement + gel.shear(traction)
    return Pressed(indentation, pressure, displacement, traction, force, approach, approach / layer.thickness)
