"""The touch sensor: its size, its grid of pixels, its frame.

Sensor frame: the origin is the centre of the sensor plane, x points out of the gel, y along the columns and z
along the rows of the reading. Seen from the sensor's inside, along +x, y is to the right and z is down, so a
reading with row 0 at the top is what the camera behind the gel sees, not mirrored.
"""

import numpy as np

# Edge of the square sensor plane in metres: 0.0218 - 0.00539, from the authors' published sensor.
SENSOR_WIDTH = 0.01641
# Pixels along each edge (supplement, "Simulating Touch").
RESOLUTION = 100
# w: the depth of the sensor in metres; what lies further from the sensor plane is not touched.
SENSOR_RANGE = 0.025

# Metres from the origin within which points in single precision are right to a micrometre.
FURTHEST = 16.0

PIXEL = SENSOR_WIDTH / RESOLUTION

# (RESOLUTION,) centres of the pixels on the sensor plane: y of the columns, and z of the rows.
PIXEL_CENTRES = ((np.arange(RESOLUTION) + 0.5) / RESOLUTION - 0.5) * SENSOR_WIDTH

# (RESOLUTION, RESOLUTION, 3) the pixels on the sensor plane, sensor frame.
_Y, _Z = np.meshgrid(PIXEL_CENTRES, PIXEL_CENTRES)
SENSOR_PLANE = np.stack([np.zeros_like(_Y), _Y, _Z], axis=2)


def local_points(depth: np.ndarray, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """The local point cloud of one sensor: its pose applied to its depth map.

    Args:
        depth: (100, 100) distance from the sensor plane, +inf where nothing is in range.
        position: (3,) and rotation: (3, 3) of the sensor; columns of the rotation are the frame's axes.

    Returns:
        (n, 3) float32, one point for each finite pixel, row-major, in the frame of position and rotation.

    Raises ValueError if the sensor is so far from the origin that single precision is too coarse for points.
    """
    if not np.abs(position).max() <= FURTHEST:
        raise ValueError(
            f"a sensor at {np.asarray(position).tolist()} m is too far from the origin for points in single "
            f"precision, at most {FURTHEST:g} m: give poses in a frame whose origin is near the object"
        )
    touched = np.flatnonzero(np.isfinite(depth.ravel()))
    points = SENSOR_PLANE.reshape(-1, 3)[touched]
    points[:, 0] = depth.ravel()[touched]
    return (points @ np.asarray(rotation).T + position).astype(np.float32)
