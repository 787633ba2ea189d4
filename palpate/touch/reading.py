"""What touch sensors report: depth maps, local clouds and readings, also of an elastic gel that is pressed. A pressed
sensor's whole gel takes part, and its image shows a window of it."""

import logging
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from palpate.sensor import DIGIT, Sensor
from palpate.touch.shading import shade, shade_impression

if TYPE_CHECKING:  # engines are imported where they are used: what shades a face again needs none
    from palpate.scene import Scene
    from palpate.touch.rays import RayCaster

log = logging.getLogger(__name__)

# Of the default sensor; `palpate/sensors/digit.yaml` has their sources.
SENSOR_WIDTH, RESOLUTION, SENSOR_RANGE = DIGIT.width, DIGIT.resolution[0], DIGIT.range
PIXEL_CENTRES = DIGIT.pixel_centres[0]

FURTHEST = 16.0  # metres from the origin within which points in single precision are right to a micrometre
LARGEST_STRAIN = 0.4  # of the thickness: what linear theory gives beyond it is said to be doubtful (docs/gel.md)
MARKER_RADIUS = 2.5e-4  # m, chosen: dots of 0.5 mm, some 1 to 2 mm apart, are what marked gels have


def warn_of_strain(name: str, strain: np.ndarray) -> None:
    """Log a warning if a gel was pressed in beyond `LARGEST_STRAIN`; name: of the object; strain: of any shape."""
    if (deepest := float(strain.max())) > LARGEST_STRAIN:
        text = "%s: a gel is pressed in by %.2f of its thickness; linear theory holds up to about %g"
        log.warning(text, name, deepest, LARGEST_STRAIN)


class TouchReading(NamedTuple):
    """Reports of sensors; `...` are the leading axes of their poses. Sensors without contact have reading, points and
    point_count 0: their reading is `empty_reading(sensor)`."""

    success: np.ndarray  # (...) bool, whether anything is in range of the sensor
    depth: np.ndarray  # (..., r, c) float32 metres from the sensor plane, +inf where nothing is in range
    reading: np.ndarray  # (..., r, c, 3) uint8
    points: np.ndarray  # (..., r c, 3) float32 local point clouds in the frame of the sensors' poses; the rest is 0
    point_count: np.ndarray  # (...) int32, how many rows of `points` are points


def scene_tracer(scene: "Scene", sensor: Sensor = DIGIT) -> "RayCaster":
    """The search tree of a scene's object for a kind of sensor."""
    from palpate.mesh import load_geometry
    from palpate.touch.rays import RayCaster

    return RayCaster(load_geometry(scene.object_folder), scene.object_position, sensor)


def sense_scene(scene: "Scene", tracer: "RayCaster | None" = None) -> TouchReading:
    """Readings of a scene's sensors, with leading axes (g, s). tracer: default, `scene_tracer(scene)`."""
    return sense(tracer or scene_tracer(scene), scene.sensor_position, scene.sensor_rotation)


def sense(tracer: "RayCaster", position: np.ndarray, rotation: np.ndarray) -> TouchReading:
    """Simulate touch sensors at position (..., 3) and rotation (..., 3, 3), whose columns are the frame's axes. tracer:
    of the object and the kind of sensor. Raises ValueError as `trace` and `local_points` do."""
    leading, kind = np.shape(position)[:-1], tracer.sensor
    position, rotation = np.reshape(position, (-1, 3)), np.reshape(rotation, (-1, 3, 3))
    depth = tracer.trace(position, rotation)
    success = np.isfinite(depth).any(axis=(1, 2))
    reading = np.zeros((*depth.shape, 3), dtype=np.uint8)
    points = np.zeros((len(depth), np.prod(kind.resolution), 3), dtype=np.float32)
    point_count = np.zeros(len(depth), dtype=np.int32)
    for sensor in np.flatnonzero(success):
        reading[sensor] = shade(depth[sensor], kind)
        cloud = local_points(depth[sensor], position[sensor], rotation[sensor], kind)
        points[sensor, : len(cloud)], point_count[sensor] = cloud, len(cloud)
    arrays = (success, depth, reading, points, point_count)
    return TouchReading(*(array.reshape(*leading, *array.shape[1:]) for array in arrays))


def local_points(depth: np.ndarray, position: np.ndarray, rotation: np.ndarray, sensor: Sensor = DIGIT) -> np.ndarray:
    """The local point cloud (n, 3) float32 of a depth map (r, c): its finite pixels, row-major, in the frame of
    position (3,) and rotation (3, 3). Raises ValueError for a sensor too far from the origin for single precision."""
    if not np.abs(position).max() <= FURTHEST:
        raise ValueError(
            f"a sensor at {np.asarray(position).tolist()} m is too far from the origin for points in single "
            f"precision, at most {FURTHEST:g} m: give poses in a frame whose origin is near the object"
        )
    touched = np.isfinite(depth)
    points = sensor.plane[touched]
    points[:, 0] = depth[touched]
    return (points @ np.asarray(rotation).T + position).astype(np.float32)


@lru_cache(maxsize=4)  # one object a sensor, so that its arrays are computed once
def face_sensor(sensor: Sensor) -> Sensor:
    """The sensor whose pixels are a sensor's, continued over the whole face of its gel: for the rays of a press."""
    (height, width), size = sensor.pixel, sensor.gel_size or sensor.size
    counts = zip(size, sensor.pixel, sensor.resolution, strict=True)
    rows, columns = (n + 2 * max(0, round((length / edge - n) / 2)) for length, edge, n in counts)
    # As far as the corners of a convex gel, pressed in by its thickness.
    thickness = sensor.material["thickness"] if sensor.material else 0.0
    reach = max(sensor.range, sensor.gel_face + thickness + sensor.gel_sag)
    wide = replace(sensor, resolution=(rows, columns), height=rows * height, width=columns * width, gel_size=size)
    return replace(wide, range=reach, gel_radius=None, background=None)


def face_window(sensor: Sensor) -> tuple[slice, ...]:
    """The rows and columns of `face_sensor(sensor)` that are the sensor's own."""
    counts = zip(face_sensor(sensor).resolution, sensor.resolution, strict=True)
    return tuple(slice((many - few) // 2, (many + few) // 2) for many, few in counts)


def press_sensor(
    depth: np.ndarray,
    sensor: Sensor,
    force: float,
    slide: tuple[float, float] = (0.0, 0.0),
    twist: float = 0.0,
    friction: float = 0.5,
) -> dict[str, np.ndarray]:
    """A sensor pressed into a surface with a force (N) along its axis: arrays by their names in the press store. depth:
    (R, C) m, of `RayCaster(..., face_sensor(sensor)).trace`, whose shape counts only. With nothing before the face, or
    a force of 0, the gel is untouched, `force` 0. Others as for `gel.press`. Raises ConfigError for a gel that can't be
    pressed."""
    from palpate.touch.gel import Layer, press

    layer, nothing = Layer(**sensor.require_material()), np.zeros((*sensor.resolution, 2))
    indentation, pressure, displacement, numbers = nothing[..., 0], nothing[..., 0], nothing, np.zeros(4)
    if force > 0 and np.isfinite(depth).any():
        surface = depth.astype(np.float64) + face_sensor(sensor).face_sag
        pressed = press(surface, sensor.pixel, layer, force, slide, twist, friction)
        window, outside = face_window(sensor), pressed.pressure.copy()
        outside[window] = 0
        indentation, pressure, displacement = (image[window] for image in pressed[:3])
        inside = 1 - outside.sum() / pressed.pressure.sum()
        numbers = np.array([force, pressed.approach, inside, pressed.strain])
    images = {"indentation": indentation, "pressure": pressure, "displacement": displacement}
    arrays = {name: image.astype(np.float32) for name, image in images.items()}
    arrays |= {"reading": shade_pressed(indentation, sensor, displacement)}
    arrays |= {"markers": markers(displacement, sensor)} if sensor.markers else {}
    return arrays | dict(zip(("force", "approach", "inside", "strain"), numbers, strict=True))


def stacked(rows: Sequence[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Arrays (n, ...) of n rows with the same names."""
    return {name: np.stack([row[name] for row in rows]) for name in rows[0]}


def press_sensors(
    tracer: "RayCaster", sensor: Sensor, position: np.ndarray, rotation: np.ndarray, force: np.ndarray
) -> dict[str, np.ndarray]:
    """Sensors at poses (..., 3) and (..., 3, 3), each pressed with its force (...), N: the arrays of `press_sensor`
    with these axes first. tracer: of the object and `face_sensor(sensor)`. Raises as `press_sensor` and `trace` do."""
    poses = np.reshape(position, (-1, 1, 3)), np.reshape(rotation, (-1, 1, 3, 3))
    rows = []
    for newton, *pose in zip(np.ravel(force), *poses, strict=True):
        depth = tracer.trace(*pose)[0] if newton > 0 else np.full((1, 1), np.inf)
        rows.append(press_sensor(depth, sensor, float(newton)))
    return {name: np.reshape(array, np.shape(force) + array.shape[1:]) for name, array in stacked(rows).items()}


def shade_pressed(indentation: np.ndarray, sensor: Sensor, displacement: np.ndarray | None = None) -> np.ndarray:
    """Readings (r, c, 3) uint8 of a deformed face (r, c), m into the gel, with the sensor's dots; displacement: of the
    dots, (r, c, 2) m, default 0."""
    reading = shade_impression(indentation, sensor, sensor.face_sag)
    if not sensor.markers:
        return reading
    covered, (z, y) = np.zeros(sensor.resolution), np.ogrid[tuple(map(slice, sensor.resolution))]
    for row, column in markers(displacement, sensor).reshape(-1, 2):
        away = np.hypot((y - column) * sensor.pixel[1], (z - row) * sensor.pixel[0])
        covered = np.maximum(covered, np.clip(0.5 + (MARKER_RADIUS - away) / max(sensor.pixel), 0, 1))
    return np.rint(reading * (1 - (1 - 0.1) * covered[..., None])).astype(np.uint8)


def markers(displacement: np.ndarray | None, sensor: Sensor) -> np.ndarray:
    """(m, n, 2) float32 row and column of a sensor's dots, its gel moved sideways by (r, c, 2) m; (0, 0) is the first
    pixel's centre. Untouched they are evenly spaced over the image, half a spacing from its edges."""
    from scipy.ndimage import map_coordinates

    moved = np.zeros((*sensor.resolution, 2)) if displacement is None else displacement
    dots: Any = sensor.markers
    counts = zip((dots["rows"], dots["columns"]), sensor.resolution, strict=True)
    row, column = np.meshgrid(*((np.arange(n) + 0.5) / n * pixels - 0.5 for n, pixels in counts), indexing="ij")
    y, z = (map_coordinates(moved[..., axis], [row, column], order=1, mode="nearest") for axis in (0, 1))
    return np.stack([row + z / sensor.pixel[0], column + y / sensor.pixel[1]], axis=-1).astype(np.float32)
