"""Touch: from an object's mesh and the sensors' poses to depth maps, local point clouds and readings.

Importing this package loads no engine: embree and libigl come with the first use of a tracer.
"""

from palpate.lazy import lazy_exports

EXPORTS = {
    "rays": ["RayCaster"],
    "reading": ["TRACERS", "TouchReading", "scene_tracer", "sense", "sense_scene", "shallow_touches"],
    "sensor": ["PIXEL_CENTRES", "RESOLUTION", "SENSOR_RANGE", "SENSOR_WIDTH", "local_points"],
    "shading": ["DIFFUSE", "LIGHTS", "empty_reading", "impression", "normals", "shade"],
    "sphere_tracing": ["SphereTracer"],
    "tracing": ["Tracer"],
}
__all__, __getattr__ = lazy_exports(__name__, EXPORTS)
