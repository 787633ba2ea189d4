"""Touch: from an object's mesh and the sensors' poses to depth maps, local point clouds and readings. Importing this
package loads no engine: embree comes with the first use of a `RayCaster`."""

from palpate.lazy import lazy_exports

EXPORTS = {
    "gel": ["Layer", "press"],
    "presses": ["press_object"],
    "rays": ["RayCaster"],
    "reading": [
        *("PIXEL_CENTRES", "RESOLUTION", "SENSOR_RANGE", "SENSOR_WIDTH", "TouchReading"),
        *("face_sensor", "local_points", "press_sensor", "press_sensors"),
        *("scene_tracer", "sense", "sense_scene", "shade_pressed", "warn_of_strain"),
    ],
    "shading": ["empty_reading", "impression", "normals", "shade"],
}
__all__, __getattr__ = lazy_exports(__name__, EXPORTS)
