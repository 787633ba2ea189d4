"""What a sensor reads when it is pressed: its whole gel takes part, and its image shows a window of it."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from palpate.mesh import load_geometry
from palpate.sensor import Sensor
from palpate.touch.gel import Layer, press
from palpate.touch.shading import shade_impression

if TYPE_CHECKING:
    from palpate.scene import Scene
    from palpate.touch.rays import RayCaster

LARGEST_STRAIN = 0.4  # of the thickness: what linear theory gives beyond it is said to be doubtful (docs/gel.md)
MARKER_RADIUS = 2.5e-4  # m, chosen: dots of 0.5 mm, some 1 to 2 mm apart, are what marked gels have
MARKER_SHADE = 0.1  # of the light that the gel sends back beside a dot


class PressedReading(NamedTuple):
    """What pressed sensors report; `...` are their leading axes. Images are the window that the sensor sees."""

    reading: np.ndarray  # (..., r, c, 3) uint8
    indentation: np.ndarray  # (..., r, c) float32 m, of the face into the gel; negative where it bulges
    pressure: np.ndarray  # (..., r, c) float32 Pa
    displacement: np.ndarray  # (..., r, c, 2) float32 m, of the face sideways: y, z
    markers: np.ndarray | None  # (..., m, n, 2) float32, row and column of each dot; None for a sensor without
    force: np.ndarray  # (...) float64 N
    approach: np.ndarray  # (...) float64 m, of the object from its first touch of the gel
    inside: np.ndarray  # (...) float64, share of the force within the image; 0 without a force
    strain: np.ndarray  # (...) float64, approach / thickness


def face_sensor(sensor: Sensor) -> Sensor:
    """The sensor whose pixels are a sensor's, continued over the whole face of its gel: for the rays of a press."""
    (rows, columns), edges = sensor.resolution, sensor.pixel
    height, width = sensor.gel_size or sensor.size
    more = [
        max(0, round((size / edge - n) / 2))
        for size, edge, n in zip((height, width), edges, sensor.resolution, strict=True)
    ]
    rows, columns = rows + 2 * more[0], columns + 2 * more[1]
    # As far as the corners of a convex gel, pressed in by its thickness.
    thickness = sensor.material["thickness"] if sensor.material else 0.0
    reach = max(sensor.range, sensor.gel_face + thickness + sensor.gel_sag)
    size = height, width
    height, width = rows * edges[0], columns * edges[1]
    wide = replace(sensor, resolution=(rows, columns), height=height, width=width, range=reach, gel_size=size)
    return replace(wide, gel_radius=None, background=None)


def press_sensor(
    depth: np.ndarray,
    sensor: Sensor,
    force: float,
    slide: tuple[float, float] = (0.0, 0.0),
    twist: float = 0.0,
    friction: float = 0.5,
) -> PressedReading:
    """A sensor pressed into a surface with a force (N) along its axis; slide, twist, friction: as for `gel.press`.

    depth: (R, C) m, of `RayCaster(..., face_sensor(sensor)).trace`. Only its shape counts: the force decides how deep
    the surface goes. Where nothing is before the face, or the force is 0, the gel is as if untouched and `force` is 0.

    Raises ConfigError for a sensor whose gel can't be pressed.
    """
    layer, face = Layer(**sensor.require_material()), face_sensor(sensor)
    if not (force > 0 and np.isfinite(depth).any()):
        return _untouched(sensor)
    surface = depth.astype(np.float64) + face.face_sag
    pressed = press(surface, sensor.pixel, layer, force, slide, twist, friction)
    around = [(many - few) // 2 for many, few in zip(face.resolution, sensor.resolution, strict=True)]
    window = tuple(slice(first, first + n) for first, n in zip(around, sensor.resolution, strict=True))
    outside = pressed.pressure.copy()
    outside[window] = 0
    inside = 1 - outside.sum() / pressed.pressure.sum()
    images = [image[window] for image in pressed[:3]]
    return _reading(sensor, images, [force, pressed.approach, inside, pressed.strain])


def press_sensors(
    tracer: "RayCaster", sensor: Sensor, position: np.ndarray, rotation: np.ndarray, force: np.ndarray
) -> PressedReading:
    """Sensors at poses (..., 3) and (..., 3, 3), each pressed with its force (...), N; arrays with these leading axes.

    tracer: of the object and `face_sensor(sensor)`. Raises ConfigError as `press_sensor`, ValueError for an invalid
    pose.
    """
    leading = np.shape(force)
    position, rotation = np.reshape(position, (-1, 3)), np.reshape(rotation, (-1, 3, 3))
    readings = []
    for number, newton in enumerate(np.ravel(force)):
        one = slice(number, number + 1)
        depth = tracer.trace(position[one], rotation[one])[0] if newton > 0 else np.full((1, 1), np.inf)
        readings.append(press_sensor(depth, sensor, float(newton)))
    fields = zip(*readings, strict=True)
    arrays = (None if each[0] is None else np.reshape(each, (*leading, *each[0].shape)) for each in fields)
    return PressedReading._make(arrays)


def press_scene(scene: "Scene", sensor: Sensor, force: np.ndarray) -> dict[str, np.ndarray | None]:
    """The sensors of a scene's grasps, each pressed with its force (g, s), N: arrays (g, s, ...) by their names in the
    touch store. Raises ConfigError as `press_sensor`.
    """
    from palpate.touch.rays import RayCaster  # here: what shades a face again needs no embree

    tracer = RayCaster(load_geometry(scene.object_folder), scene.object_position, face_sensor(sensor))
    arrays = press_sensors(tracer, sensor, scene.sensor_position, scene.sensor_rotation, force)._asdict()
    del arrays["strain"]
    return arrays


def shade_pressed(indentation: np.ndarray, sensor: Sensor, displacement: np.ndarray | None = None) -> np.ndarray:
    """Readings (r, c, 3) uint8 of a deformed face (r, c), m into the gel, with the sensor's dots.

    displacement: (r, c, 2) m, of the dots; default 0.
    """
    reading = shade_impression(indentation, sensor, sensor.face_sag)
    dots = markers(np.zeros((*sensor.resolution, 2)) if displacement is None else displacement, sensor)
    if dots is None:
        return reading
    covered = np.zeros(sensor.resolution)
    for row, column in dots.reshape(-1, 2):
        z = (np.arange(sensor.resolution[0]) - row)[:, None] * sensor.pixel[0]
        y = (np.arange(sensor.resolution[1]) - column)[None] * sensor.pixel[1]
        edge = (MARKER_RADIUS - np.hypot(y, z)) / max(sensor.pixel)
        covered = np.maximum(covered, np.clip(0.5 + edge, 0, 1))
    return np.rint(reading * (1 - (1 - MARKER_SHADE) * covered[..., None])).astype(np.uint8)


def markers(displacement: np.ndarray, sensor: Sensor) -> np.ndarray | None:
    """(m, n, 2) float32 row and column of the dots of a gel that is moved sideways by (r, c, 2) m.

    Untouched they are evenly spaced over the image, half a spacing from its edges. (0, 0) is the first pixel's centre.
    None for a sensor without dots.
    """
    if sensor.markers is None:
        return None
    from scipy.ndimage import map_coordinates

    count = sensor.markers["rows"], sensor.markers["columns"]
    places = [(np.arange(n) + 0.5) / n * pixels - 0.5 for n, pixels in zip(count, sensor.resolution, strict=True)]
    row, column = np.meshgrid(*places, indexing="ij")
    y, z = (map_coordinates(displacement[..., axis], [row, column], order=1, mode="nearest") for axis in (0, 1))
    return np.stack([row + z / sensor.pixel[0], column + y / sensor.pixel[1]], axis=-1).astype(np.float32)


def _reading(sensor: Sensor, images: Sequence[np.ndarray], numbers: Sequence[float]) -> PressedReading:
    """The reading of the images and numbers of `PressedReading`, in its order and types."""
    indentation, _, displacement = images
    reading, dots = shade_pressed(indentation, sensor, displacement), markers(displacement, sensor)
    single = [image.astype(np.float32) for image in images]
    return PressedReading._make([reading, *single, dots, *map(np.float64, numbers)])


def _untouched(sensor: Sensor) -> PressedReading:
    nothing = np.zeros(sensor.resolution)
    return _reading(sensor, [nothing, nothing, np.zeros((*sensor.resolution, 2))], [0, 0, 0, 0])
