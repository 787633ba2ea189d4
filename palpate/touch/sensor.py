"""Local point clouds of a sensor, and the constants of the default one, the DIGIT."""

import numpy as np

from palpate.sensor import DIGIT, Sensor

# Of the default sensor; `palpate/sensors/digit.yaml` has their sources.
SENSOR_WIDTH, RESOLUTION, SENSOR_RANGE = DIGIT.width, DIGIT.resolution[0], DIGIT.range
PIXEL_CENTRES = DIGIT.pixel_centres[0]

FURTHEST = 16.0  # metres from the origin within which points in single precision are right to a micrometre


def local_points(depth: np.ndarray, position: np.ndarray, rotation: np.ndarray, sensor: Sensor = DIGIT) -> np.ndarray:
    """The local point cloud (n, 3) float32 of a sensor: its finite pixels, row-major, in the frame of its pose.

    depth: (r, c) distance from the sensor plane, +inf where nothing is in range; position: (3,); rotation: (3, 3),
    whose columns are the frame's axes. Raises ValueError if the sensor is too far from the origin for single precision.
    """
    if not np.abs(position).max() <= FURTHEST:
        raise ValueError(
            f"a sensor at {np.asarray(position).tolist()} m is too far from the origin for points in single "
            f"precision, at most {FURTHEST:g} m: give poses in a frame whose origin is near the object"
        )
    touched = np.flatnonzero(np.isfinite(depth.ravel()))
    points = sensor.plane.reshape(-1, 3)[touched]
    points[:, 0] = depth.ravel()[touched]
    return (points @ np.asarray(rotation).T + position).astype(np.float32)
