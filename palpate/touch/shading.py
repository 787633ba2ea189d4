"""From a depth map to a reading: the impression in the gel, its normals, and coloured lights.

The equations are the supplement's ("Simulating Touch": Phong's reflection without ambient and specular terms). Lambda
and the lights' positions, which it does not give, are the sensor's (`palpate/sensors/digit.yaml`). All lengths are
metres, so that normals are true; the supplement has x and y in sensor widths.
"""

from collections.abc import Iterator

import numpy as np

from palpate.sensor import DIGIT, Sensor, Size


def impression(depth: np.ndarray, sensor: Sensor = DIGIT) -> np.ndarray:
    """Impressions D' = ReLU(w - D), metres, 0 where nothing is in range (depth +inf); w: distance of the free gel."""
    reach = sensor.range if sensor.gel_radius is None else sensor.reach.astype(depth.dtype)
    return np.maximum(reach - depth, 0)


def normals(height: np.ndarray, pixel: Size = DIGIT.pixel) -> np.ndarray:
    """Unit normals [-dD'/dx, -dD'/dy, 1] / |.| (..., r, c, 3), float32, of surfaces (..., r, c): central differences,
    one-sided at the border; first along the columns (the sensor's y). pixel: edges along rows and columns, metres."""
    along_rows, along_columns = np.gradient(np.asarray(height, dtype=np.float32), *pixel, axis=(-2, -1))
    length = np.sqrt(along_rows**2 + along_columns**2 + 1)
    return np.stack([-along_columns / length, -along_rows / length, 1 / length], axis=-1)


def smoothed(height: np.ndarray, sensor: Sensor) -> np.ndarray:
    """Impressions (..., r, c) as a soft gel takes them (Si and Yuan 2022, Taxim's `deformApprox`): Gaussian filters of
    the deviations (m) in `pyramid`, after each of which pixels deeper than `held` of the deepest get their depth back;
    then one of `last`. Without settings for it as they are."""
    if not (settings := sensor.smoothing):
        return height
    from scipy.ndimage import gaussian_filter

    def filtered(image: np.ndarray, sigma: float) -> np.ndarray:
        return gaussian_filter(image, [sigma / edge for edge in sensor.pixel], mode="mirror", axes=(-2, -1))

    held, result = height > settings["held"] * height.max(axis=(-2, -1), keepdims=True), height
    for sigma in settings["pyramid"]:
        result = np.where(held, height, filtered(result, sigma))
    return filtered(result, settings["last"])


def shade(depth: np.ndarray, sensor: Sensor = DIGIT) -> np.ndarray:
    """Readings (..., r, c, 3) uint8 of depth maps (..., r, c), m, +inf where nothing is in range (ValueError for NaN,
    -inf): the sum over the lights that a surface faces of their colour times lambda n . l; 0 beside a round gel. A
    background image is changed by as much as the shading differs from that of the untouched gel."""
    depth = np.asarray(depth, dtype=np.float32)
    if not (depth > -np.inf).all():
        raise ValueError("expected depths in metres, +inf where nothing is in range, got NaN or -inf")
    return shade_impression(smoothed(impression(depth, sensor), sensor), sensor, sensor.sag)


def shade_impression(height: np.ndarray, sensor: Sensor, sag: np.ndarray) -> np.ndarray:
    """As `shade`, of a face (..., r, c), m into the gel, that lies `sag` (r, c), m, below its middle if undeformed."""

    def face_light(height: np.ndarray) -> np.ndarray:
        surface = height.astype(np.float32) + sag.astype(np.float32)
        return light_of(surface, normals(surface, sensor.pixel), sensor) * sensor.on_gel[..., None]

    light = face_light(height)
    if sensor.background is not None:
        light += sensor.background - face_light(np.zeros(sensor.resolution))
    return np.rint(np.clip(light, 0, 255)).astype(np.uint8)


def light_of(height: np.ndarray, normal: np.ndarray, sensor: Sensor = DIGIT) -> np.ndarray:
    """Light (..., r, c, 3) float32, grey levels, of normals (..., r, c, 3), without a background. height: (..., r, c) m
    above the plane at the sensor's range, towards the sensor plane; of a flat gel the impression."""
    if table := sensor.colour_table:
        # A polynomial of the normal, whose coefficients change over the image.
        columns, rows = np.meshgrid(*(np.linspace(-1, 1, n, dtype=np.float32) for n in sensor.resolution[::-1]))
        over_image = np.stack(list(monomials(columns, rows, table["place"], 0)), axis=-1)
        over_normal = list(monomials(*flattened(normal, table["steepest"]), table["normal"], 1))
        factors = np.array(table["polynomial"], dtype=np.float32).reshape(len(over_normal), over_image.shape[-1], 3)
        terms = zip(over_normal, factors, strict=True)
        return sensor.diffuse * sum(term[..., None] * (over_image @ own) for term, own in terms)
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
