"""Everything the touch sensors of a scene report."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from palpate.mesh import load_geometry
from palpate.sensor import DIGIT, Sensor
from palpate.touch.rays import RayCaster
from palpate.touch.sensor import local_points
from palpate.touch.shading import shade

if TYPE_CHECKING:
    from palpate.scene import Scene


class TouchReading(NamedTuple):
    """Reports of sensors; `...` are the leading axes of their poses.

    Sensors without contact have reading, points and point_count 0: their reading is `empty_reading(sensor)`.
    """

    success: np.ndarray  # (...) bool, whether anything is in range of the sensor
    depth: np.ndarray  # (..., r, c) float32 metres from the sensor plane, +inf where nothing is in range
    reading: np.ndarray  # (..., r, c, 3) uint8
    points: np.ndarray  # (..., r c, 3) float32 local point clouds in the frame of the sensors' poses; the rest is 0
    point_count: np.ndarray  # (...) int32, how many rows of `points` are points


def sense(tracer: RayCaster, position: np.ndarray, rotation: np.ndarray) -> TouchReading:
    """Simulate touch sensors at position (..., 3) and rotation (..., 3, 3), whose columns are the frame's axes.

    tracer: of the object and the kind of sensor. Raises ValueError for an invalid pose, and for a sensor in contact too
    far from the origin.
    """
    leading = np.shape(position)[:-1]
    position, rotation = np.reshape(position, (-1, 3)), np.reshape(rotation, (-1, 3, 3))
    depth = tracer.trace(position, rotation)
    success = np.isfinite(depth).any(axis=(1, 2))
    k, kind = len(depth), tracer.sensor
    reading = np.zeros((*depth.shape, 3), dtype=np.uint8)
    points = np.zeros((k, np.prod(kind.resolution), 3), dtype=np.float32)
    point_count = np.zeros(k, dtype=np.int32)
    for sensor in np.flatnonzero(success):
        reading[sensor] = shade(depth[sensor], kind)
        cloud = local_points(depth[sensor], position[sensor], rotation[sensor], kind)
        points[sensor, : len(cloud)] = cloud
        point_count[sensor] = len(cloud)
    arrays = (success, depth, reading, points, point_count)
    return TouchReading(*(array.reshape(*leading, *array.shape[1:]) for array in arrays))


def scene_tracer(scene: "Scene", sensor: Sensor = DIGIT) -> RayCaster:
    """The search tree of a scene's object for a kind of sensor."""
    return RayCaster(load_geometry(scene.object_folder), scene.object_position, sensor)


def sense_scene(scene: "Scene", tracer: RayCaster | None = None) -> TouchReading:
    """Readings of a scene's sensors, with leading axes (g, s). tracer: default, `scene_tracer(scene)`."""
    return sense(tracer or scene_tracer(scene), scene.sensor_position, scene.sensor_rotation)
