"""Touch: from an object's mesh and the sensors' poses to depth maps, local point clouds and readings.

Importing this package loads no engine: embree comes with the first use of a `RayCaster`.
"""

from palpate.lazy import lazy_exports

EXPORTS = {
    "gel": ["Layer", "press"],
    "pressing": [
        *("LARGEST_STRAIN", "PressedReading", "face_sensor", "press_scene", "press_sensor", "press_sensors"),
        "shade_pressed",
    ],
    "presses": ["press_object"],
    "rays": ["RayCaster"],
    "reading": ["TouchReading", "scene_tracer", "sense", "sense_scene"],
    "sensor": ["PIXEL_CENTRES", "RESOLUTION", "SENSOR_RANGE", "SENSOR_WIDTH", "local_points"],
    "shading": ["DIFFUSE", "LIGHTS", "empty_reading", "impression", "normals", "shade"],
}
__all__, __getattr__ = lazy_exports(__name__, EXPORTS)
