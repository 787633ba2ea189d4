"""Everything the touch sensors of a scene report."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from palpate.mesh import load_visual
from palpate.sensor import DIGIT, Sensor
from palpate.touch.rays import RayCaster
from palpate.touch.sensor import local_points
from palpate.touch.shading import shade
from palpate.touch.sphere_tracing import SphereTracer
from palpate.touch.tracing import Tracer

if TYPE_CHECKING:
    from palpate.scene import Scene

# By the names that the config has for them.
TRACERS = {"embree": RayCaster, "sphere_tracing": SphereTracer}


class TouchReading(NamedTuple):
    """What sensors report; `...` are the leading axes of their poses.

    All but `success` and `depth` is computed for sensors in contact only, and 0 for the others: the reading of
    any other is `empty_reading(sensor)`, and it has no points.

    Attributes:
        success: (...) bool, whether anything is in range of the sensor.
        depth: (..., r, c) float32 metres from the sensor plane, +inf where nothing is in range.
        reading: (..., r, c, 3) uint8.
        points: (..., r c, 3) float32 local point clouds in the frame of the sensors' poses; the rest is 0.
        point_count: (...) int32, how many rows of `points` are points.
    """

    success: np.ndarray
    depth: np.ndarray
    reading: np.ndarray
    points: np.ndarray
    point_count: np.ndarray


def sense(tracer: Tracer, position: np.ndarray, rotation: np.ndarray) -> TouchReading:
    """Simulate touch sensors on one object.

    Args:
        tracer: the object, a `RayCaster` or a `SphereTracer`, of the sensors' kind.
        position: (..., 3), rotation: (..., 3, 3) of the sensors; columns of a rotation are the frame's axes.

    Raises ValueError for a pose that is not one, and for a sensor in contact too far from the origin.
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


def shallow_touches(sensed: TouchReading, sensor: Sensor) -> int:
    """How many touches are deepest nearer to the end of the sensor's range than to the gel's face on the hand.

    A hand that stops at the object has few of them: a tilted finger, or an edge beside the gel. With sensors that are
    not where the hand's gels are, readings are slivers.
    """
    deepest = (sensor.reach - sensed.depth[sensed.success]).max(axis=(1, 2), initial=-np.inf)
    return int((deepest < (sensor.range - sensor.gel_face) / 2).sum())


def scene_tracer(scene: "Scene", method: str = "embree", sensor: Sensor = DIGIT) -> Tracer:
    """The search tree of a scene's object for a kind of sensor, by a method of `TRACERS`."""
    return TRACERS[method](load_visual(scene.object_folder), scene.object_position, sensor=sensor)


def sense_scene(scene: "Scene", tracer: Tracer | None = None) -> TouchReading:
    """What the sensors of a scene report, with leading axes (g, s). tracer: default, `scene_tracer(scene)`."""
    return sense(tracer or scene_tracer(scene), scene.sensor_position, scene.sensor_rotation)
