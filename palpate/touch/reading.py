"""Everything the four touch sensors of a grasp report."""

from typing import NamedTuple

import numpy as np

from palpate.touch.sensor import RESOLUTION, local_points
from palpate.touch.shading import shade
from palpate.touch.tracing import Tracer


class TouchReading(NamedTuple):
    """What k sensors feel. All but `success` and `depth` is computed for successful sensors only, else 0
    (if the tracer's plan leaves it out).

    Attributes:
        success: (k,) bool, whether anything is in range of the sensor.
        depth: (k, 100, 100) float32 metres from the sensor plane, +inf where nothing is in range.
        reading: (k, 100, 100, 3) uint8; a sensor that feels nothing would read `empty_reading()`.
        points: (k, 10000, 3) float32 local point clouds in the frame of the sensors' poses; the rest is 0.
        point_count: (k,) int32, how many rows of `points` are points.
    """

    success: np.ndarray
    depth: np.ndarray
    reading: np.ndarray
    points: np.ndarray
    point_count: np.ndarray


def sense(tracer: Tracer, position: np.ndarray, rotation: np.ndarray) -> TouchReading:
    """Simulate k touch sensors on one object.

    Args:
        tracer: the object, a `RayCaster` or a `SphereTracer`; its plan says what is made.
        position: (k, 3), rotation: (k, 3, 3) of the sensors; columns of a rotation are the frame's axes.
    """
    depth = tracer.trace(position, rotation)
    success = np.isfinite(depth).any(axis=(1, 2))
    k = len(depth)
    reading = np.zeros((k, RESOLUTION, RESOLUTION, 3), dtype=np.uint8)
    points = np.zeros((k, RESOLUTION**2, 3), dtype=np.float32)
    point_count = np.zeros(k, dtype=np.int32)
    every_reading = tracer.plan.needs("readings of sensors that touched nothing")
    every_cloud = tracer.plan.needs("points of sensors that touched nothing")
    for sensor in np.flatnonzero(success | every_reading):
        reading[sensor] = shade(depth[sensor])
    for sensor in np.flatnonzero(success | every_cloud):
        cloud = local_points(depth[sensor], position[sensor], rotation[sensor])
        points[sensor, : len(cloud)] = cloud
        point_count[sensor] = len(cloud)
    return TouchReading(success, depth, reading, points, point_count)
