"""Touch: from an object's mesh and the sensors' poses to depth maps, local point clouds and readings.

Only what can be in touch is computed: see `Tracer` and `TouchReading`.
"""

from palpate.touch.rays import RayCaster
from palpate.touch.reading import TRACERS, TouchReading, scene_tracer, sense, sense_scene, shallow_touches
from palpate.touch.sensor import PIXEL_CENTRES, RESOLUTION, SENSOR_RANGE, SENSOR_WIDTH, local_points
from palpate.touch.shading import DIFFUSE, LIGHTS, empty_reading, impression, normals, shade
from palpate.touch.sphere_tracing import SphereTracer
from palpate.touch.tracing import Tracer

__all__ = [
    "DIFFUSE",
    "LIGHTS",
    "PIXEL_CENTRES",
    "RESOLUTION",
    "SENSOR_RANGE",
    "SENSOR_WIDTH",
    "TRACERS",
    "RayCaster",
    "SphereTracer",
    "TouchReading",
    "Tracer",
    "empty_reading",
    "impression",
    "local_points",
    "normals",
    "scene_tracer",
    "sense",
    "sense_scene",
    "shade",
    "shallow_touches",
]
