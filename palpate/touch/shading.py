"""From a depth map to a reading: the impression in the gel, its normals, and coloured lights.

The equations are the supplement's ("Simulating Touch": Phong's reflection without ambient and specular terms). Lambda
and the lights' positions, which it does not give, are the sensor's (`palpate/sensors/digit.yaml`). All lengths are
metres, so that normals are true; the supplement has x and y in sensor widths.
"""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from palpate.sensor import DIGIT, Sensor, Size

# Of the default sensor: P_r, P_g, P_b (3, 3) as (y, z, height above the undeformed surface), metres; and lambda.
LIGHTS, DIFFUSE = np.stack([place for place, *_ in DIGIT.lamps]), DIGIT.diffuse


def impression(depth: np.ndarray, sensor: Sensor = DIGIT) -> np.ndarray:
    """Impressions D' = ReLU(w - D), metres, 0 where nothing is in range (depth +inf); w: distance of the free gel."""
    reach = sensor.range if sensor.gel_radius is None else sensor.reach.astype(depth.dtype)
    return np.maximum(reach - depth, 0)


def normals(height: np.ndarray, pixel: Size = DIGIT.pixel) -> np.ndarray:
    """Unit normals [-dD'/dx, -dD'/dy, 1] / |.| of surfaces (..., r, c): (..., r, c, 3), float32.

    Central differences inside, one-sided at the border; first component along the columns (the sensor's y).
    pixel: its edges along the rows' and the columns' direction, metres.
    """
    along_rows, along_columns = np.gradient(np.asarray(height, dtype=np.float32), *pixel, axis=(-2, -1))
    length = np.sqrt(along_rows**2 + along_columns**2 + 1)
    return np.stack([-along_columns / length, -along_rows / length, 1 / length], axis=-1)


def smoothed(height: np.ndarray, sensor: Sensor) -> np.ndarray:
    """Impressions (..., r, c) as a soft gel takes them: Taxim's approximation (Si and Yuan 2022, `deformApprox`).

    Gaussian filters, the standard deviations (m) of `pyramid` in turn. After each, pixels deeper than `held` of the
    deepest get their depth back: there the gel lies on the object. Then a filter of `last`. Without settings for it
    the impressions stay as they are.
    """
    settings = sensor.smoothing
    if not settings:
        return height
    held = height > settings["held"] * height.max(axis=(-2, -1), keepdims=True)
    result = height
    for sigma in settings["pyramid"]:
        result = np.where(held, height, _filtered(result, sigma, sensor))
    return _filtered(result, settings["last"], sensor)


def _filtered(height: np.ndarray, sigma: float, sensor: Sensor) -> np.ndarray:
    """Heights (..., r, c) after a Gaussian filter of `sigma` metres, mirrored at the border."""
    from scipy.ndimage import gaussian_filter

    return gaussian_filter(height, [sigma / edge for edge in sensor.pixel], mode="mirror", axes=(-2, -1))


def shade(depth: np.ndarray, sensor: Sensor = DIGIT) -> np.ndarray:
    """Readings (..., r, c, 3) uint8 of depth maps (..., r, c), metres, +inf where nothing is in range.

    The sum over the lights of their colour times lambda n . l, without those that the surface faces away from; 0 beside
    a round gel. A background image is changed by as much as the shading differs from that of the untouched gel.

    Raises ValueError for a depth that is NaN or minus infinity.
    """
    depth = np.asarray(depth, dtype=np.float32)
    if not (depth > -np.inf).all():
        raise ValueError("expected depths in metres, +inf where nothing is in range, got NaN or -inf")
    return shade_impression(smoothed(impression(depth, sensor), sensor), sensor)


def shade_impression(height: np.ndarray, sensor: Sensor = DIGIT, sag: np.ndarray | None = None) -> np.ndarray:
    """Readings (..., r, c, 3) uint8 of the gel with impressions (..., r, c), m, as they are: as `shade`.

    sag: (r, c) m that the undeformed face lies below its middle; default: `sensor.sag`.
    """
    height, sag = np.asarray(height, dtype=np.float32), sensor.sag if sag is None else sag
    light = _face_light(height, sensor, sag)
    if sensor.background is not None:
        light += sensor.background - _face_light(np.zeros(height.shape[-2:], np.float32), sensor, sag)
    return np.rint(np.clip(light, 0, 255)).astype(np.uint8)


def _face_light(height: np.ndarray, sensor: Sensor, sag: np.ndarray) -> np.ndarray:
    """Light (..., r, c, 3) of a gel with impressions (..., r, c) and the sag (r, c), grey levels, not rounded."""
    surface = height + sag.astype(np.float32)
    return light_of(surface, normals(surface, sensor.pixel), sensor) * sensor.on_gel[..., None]


def lit(height: np.ndarray, normal: np.ndarray, sensor: Sensor = DIGIT) -> np.ndarray:
    """Readings of surfaces (..., r, c) float32 with the normals (..., r, c, 3), without a background: as `shade`.

    height: metres above the plane at the sensor's range, towards the sensor plane; of a flat gel the impression.
    """
    return np.rint(np.clip(light_of(height, normal, sensor), 0, 255)).astype(np.uint8)


def light_of(height: np.ndarray, normal: np.ndarray, sensor: Sensor = DIGIT) -> np.ndarray:
    """The light (..., r, c, 3) float32 of which `lit` makes readings, grey levels, neither rounded nor clipped."""
    if table := sensor.colour_table:
        return _table_light(normal, table, sensor)
    rows, columns = (centres.astype(np.float32) for centres in sensor.pixel_centres)
    light = np.zeros((*height.shape, 3), dtype=np.float32)
    for place, colour, far in sensor.lamps:
        y, z, up = place.astype(np.float32)
        if not far:
            y, z, up = y - columns[None, :], z - rows[:, None], up - height
        cosine = normal[..., 0] * y + normal[..., 1] * z + normal[..., 2] * up
        cosine /= np.sqrt(y**2 + z**2 + up**2)
        facing = np.maximum(sensor.diffuse * cosine, 0)
        for channel in np.flatnonzero(colour):
            light[..., channel] += np.float32(colour[channel]) * facing
    return light


def _table_light(normal: np.ndarray, table: Mapping[str, Any], sensor: Sensor) -> np.ndarray:
    """Light (..., r, c, 3) by a sensor's polynomial of the normal, whose coefficients change over the image."""
    columns, rows = np.meshgrid(*(np.linspace(-1, 1, n, dtype=np.float32) for n in sensor.resolution[::-1]))
    over_image = np.stack(list(monomials(columns, rows, table["place"], 0)), axis=-1)
    over_normal = list(monomials(*flattened(normal, table["steepest"]), table["normal"], 1))
    coefficients = np.array(table["polynomial"], dtype=np.float32).reshape(len(over_normal), over_image.shape[-1], 3)
    terms = zip(over_normal, coefficients, strict=True)
    return sensor.diffuse * sum(term[..., None] * (over_image @ own) for term, own in terms)


def monomials(first: np.ndarray, second: np.ndarray, degree: int, lowest: int) -> Iterator[np.ndarray]:
    """The products first**i * second**j of lowest <= i + j <= degree, i and then j ascending."""
    return (first**i * second**j for i in range(degree + 1) for j in range(degree + 1 - i) if lowest <= i + j)


def flattened(normal: np.ndarray, steepest: float) -> tuple[np.ndarray, np.ndarray]:
    """Components y and z of normals (..., 3), those longer than `steepest` shortened to it: polynomials end there."""
    y, z = normal[..., 0], normal[..., 1]
    shorter = steepest / np.maximum(np.hypot(y, z), steepest)
    return y * shorter, z * shorter


def empty_reading(sensor: Sensor = DIGIT) -> np.ndarray:
    """The reading (r, c, 3) uint8 of a sensor that touches nothing."""
    return shade(np.full(sensor.resolution, np.inf), sensor)
