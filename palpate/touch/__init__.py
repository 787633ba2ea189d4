"""Touch: from an object's mesh and the sensors' poses to depth maps, local point clouds and readings."""

from palpate.touch.rays import RayCaster
from palpate.touch.reading import TouchReading, sense
from palpate.touch.sensor import PIXEL_CENTRES, RESOLUTION, SENSOR_RANGE, SENSOR_WIDTH, local_points
from palpate.touch.shading import DIFFUSE, LIGHTS, empty_reading, impression, normals, shade
from palpate.touch.sphere_tracing import SphereTracer

__all__ = [
    "DIFFUSE",
    "LIGHTS",
    "PIXEL_CENTRES",
    "RESOLUTION",
    "SENSOR_RANGE",
    "SENSOR_WIDTH",
    "RayCaster",
    "SphereTracer",
    "TouchReading",
    "empty_reading",
    "impression",
    "local_points",
    "normals",
    "sense",
    "shade",
]
