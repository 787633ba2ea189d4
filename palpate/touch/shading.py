"""From a depth map to a reading: the impression in the gel, its normals, and three coloured lights.

The equations are the supplement's ("Simulating Touch": Phong's reflection without ambient and specular
terms). It does not give lambda and the lights' positions; they are chosen here, see `LIGHTS` and `DIFFUSE`.
All lengths are metres, in place of the supplement's mixture (x and y in sensor widths, depth in metres): with
one unit the normal is the surface's true normal.
"""

import numpy as np

from palpate.touch.sensor import PIXEL, PIXEL_CENTRES, RESOLUTION, SENSOR_RANGE

# P_r, P_g, P_b: (3, 3) positions of the red, green and blue light as (y, z, height above the undeformed
# surface), metres. An equilateral triangle around the sensor's axis in the sensor plane (height w, so that no
# surface in the sensor's range is above the lights), red at the reading's top edge, then clockwise. The radius
# sqrt(2) w makes the three directions orthogonal at the centre of an untouched reading, which is where
# shading tells normals apart best.
_ANGLES = np.deg2rad([-90, 30, 150])
_RADIUS = np.sqrt(2) * SENSOR_RANGE
LIGHTS = np.stack([_RADIUS * np.cos(_ANGLES), _RADIUS * np.sin(_ANGLES), np.full(3, SENSOR_RANGE)], axis=1)

# lambda, the diffuse reflection constant, in grey levels: a surface that faces a light reads 255, so no pixel
# saturates. (The authors' later simulator takes twice that and saturates.)
DIFFUSE = 255.0


def impression(depth: np.ndarray) -> np.ndarray:
    """D' = ReLU(w - D), metres, same shape as `depth`; 0 where nothing is in range (depth +inf)."""
    return np.maximum(SENSOR_RANGE - depth, 0)


def normals(height: np.ndarray) -> np.ndarray:
    """Unit normals [-dD'/dx, -dD'/dy, 1] / |.| of impressions (..., 100, 100): (..., 100, 100, 3), float32.

    Central differences inside, one-sided at the border; first component along the columns (the sensor's y).
    """
    along_rows, along_columns = np.gradient(np.asarray(height, dtype=np.float32), PIXEL, axis=(-2, -1))
    length = np.sqrt(along_rows**2 + along_columns**2 + 1)
    return np.stack([-along_columns / length, -along_rows / length, 1 / length], axis=-1)


def shade(depth: np.ndarray) -> np.ndarray:
    """Readings of depth maps.

    Args:
        depth: (..., 100, 100) distance from the sensor plane in metres, +inf where nothing is in range.

    Returns:
        (..., 100, 100, 3) uint8; a channel is lambda n . l of its light, 0 where the surface faces away.

    Raises ValueError for a depth that is NaN or minus infinity.
    """
    depth = np.asarray(depth, dtype=np.float32)
    if not (depth > -np.inf).all():
        raise ValueError("expected depths in metres, +inf where nothing is in range, got NaN or -inf")
    height = impression(depth)
    return lit(height, normals(height))


def lit(height: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Readings of impressions (..., 100, 100) float32 with the normals (..., 100, 100, 3): as `shade`."""
    reading = np.empty((*height.shape, 3), dtype=np.uint8)
    for channel, light in enumerate(LIGHTS.astype(np.float32)):
        y = light[0] - PIXEL_CENTRES.astype(np.float32)[None, :]
        z = light[1] - PIXEL_CENTRES.astype(np.float32)[:, None]
        up = light[2] - height
        cosine = normal[..., 0] * y + normal[..., 1] * z + normal[..., 2] * up
        cosine /= np.sqrt(y**2 + z**2 + up**2)
        reading[..., channel] = np.rint(np.maximum(DIFFUSE * cosine, 0))
    return reading


def empty_reading() -> np.ndarray:
    """(100, 100, 3) uint8, the reading of a sensor that touches nothing."""
    return shade(np.full((RESOLUTION, RESOLUTION), np.inf))
