"""The authors' released dataset, object by object as arrays of our stores (files: `palpate.released.layout`).

- a surface is (n, 3) points of the object centred at the origin with a diagonal of 1: in the world, half of that and
  0.6 m up
- a scene is a dictionary with `touch_success` (4,), `cam_pos` (4, 3) in the world, m, `cam_rot` (4, 3) in radians about
  fixed x, then y, then z, and for each sensor `depth` (100, 100), `gel` (100, 100, 3) in 0..255 and `points` (k, 3),
  the local cloud in the world, m; the first axis of `depth` and `gel` is the sensor's y, the second its z (here: z, y)
"""

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation

from palpate.batch import UnusableObject
from palpate.camera import matrices, paper_camera
from palpate.mesh import DIAGONAL, OBJECT_POSITION
from palpate.released.layout import EMPTY_READING, IMAGES, SCENES, file_of
from palpate.released.pickles import load_plain
from palpate.sensor import DIGIT
from palpate.store.contract import SENSOR_NAMES

log = logging.getLogger(__name__)

SENSORS, RESOLUTION, SENSOR_WIDTH = len(SENSOR_NAMES), DIGIT.resolution[0], DIGIT.width
SCENE = ("touch_success", "cam_pos", "cam_rot", "depth", "gel", "points")


def read_surface(surface: Path, count: int, generator: np.random.Generator) -> dict[str, np.ndarray]:
    """The record of the surface store: `points` (count, 3) in the world, m, of which `generator` draws, in their order.
    surface: the object's file. Raises UnusableObject if there are fewer, or not finite ones."""
    points = _floats(surface, "points", load_plain(surface), (None, 3))
    if len(points) < count:
        raise UnusableObject(f"{surface}: {len(points)} points: set surface.points to as many, not to {count}")
    if len(points) > count:
        points = points[np.sort(generator.choice(len(points), count, replace=False))]
    return {"points": (points * DIAGONAL + OBJECT_POSITION).astype(np.float32)}


def read_touch(surface: Path, grasps: int) -> dict[str, np.ndarray]:
    """The record of the touch store, of the first `grasps` grasps of the object with this surface; a sensor without
    points is unsuccessful. `depth` is made from the points, each on the sensor's grid: theirs may be from another
    plane. Raises UnusableObject, naming file and field, if a scene is missing or invalid."""
    sensed = []
    for grasp in range(grasps):
        path = file_of(surface, SCENES, f"{grasp}.npy")
        if not path.is_file():
            raise UnusableObject(f"{path}: no such file, but grasps.per_object is {grasps}: the object has {grasp}")
        scene = load_plain(path)
        missing = [key for key in SCENE if key not in scene] if isinstance(scene, dict) else list(SCENE)
        if missing:
            raise UnusableObject(f"{path}: no {', '.join(missing)} in it: expected a dictionary with {SCENE}")
        sensed += [_sensor(path, sensor, scene) for sensor in range(SENSORS)]
    return {
        name: np.stack([touch[name] for touch in sensed]).reshape(grasps, SENSORS, *sensed[0][name].shape)
        for name in sensed[0]
    }


def _sensor(path: Path, sensor: int, scene: dict[str, Any]) -> dict[str, np.ndarray]:
    """What one sensor of a scene sensed, by our names."""
    position = _floats(path, "cam_pos", scene["cam_pos"], (SENSORS, 3))[sensor]
    angles = _floats(path, "cam_rot", scene["cam_rot"], (SENSORS, 3))[sensor]
    rotation = Rotation.from_euler("xyz", angles).as_matrix()
    made = {"success": np.array(False), "position": position, "rotation": rotation}
    made |= {"depth": np.full((RESOLUTION, RESOLUTION), np.inf, dtype=np.float32)}
    made |= {"reading": np.zeros((RESOLUTION, RESOLUTION, 3), dtype=np.uint8)}
    made |= {"points": np.zeros((RESOLUTION**2, 3), dtype=np.float32), "point_count": np.array(0, dtype=np.int32)}
    where = f"of sensor {sensor}"
    if len(scene["points"]) != SENSORS or np.size(scene["touch_success"]) != SENSORS:
        raise UnusableObject(f"{path}: expected touch_success and points of {SENSORS} sensors")
    if not np.ravel(scene["touch_success"])[sensor] or not np.size(scene["points"][sensor]):
        return made
    points = _floats(path, f"points {where}", scene["points"][sensor], (None, 3))
    if len(points) > RESOLUTION**2:
        raise UnusableObject(f"{path}: {len(points)} points {where}, more than the {RESOLUTION**2} pixels that it has")
    local = (points - position) @ rotation
    row, column = (_pixel(local[:, axis]) for axis in (2, 1))
    row, column, local, points = (values[np.lexsort((column, row))] for values in (row, column, local, points))
    inside = (row >= 0) & (row < RESOLUTION) & (column >= 0) & (column < RESOLUTION)
    np.minimum.at(made["depth"], (row[inside], column[inside]), local[inside, 0].astype(np.float32))
    if np.isfinite(made["depth"]).sum() != len(points):
        log.warning("%s: the points %s are not on a grid of the sensor plane, one a pixel", path, where)
    made["points"][: len(points)] = points
    made["reading"] = _reading(path, f"gel {where}", scene["gel"][sensor])
    return made | {"success": np.array(True), "point_count": np.array(len(points), dtype=np.int32)}


def _pixel(along: np.ndarray) -> np.ndarray:
    """Rows or columns (k,) of points from their coordinate along the sensor plane, m. Whether points are at pixels'
    centres (as here) or corners (as in the authors' network) their circular mean within a pixel shows."""
    place = along / SENSOR_WIDTH * RESOLUTION + RESOLUTION / 2
    turn = np.angle(np.exp(2j * np.pi * place).mean()) / (2 * np.pi)  # in [-0.5, 0.5]
    within = turn if turn >= -0.25 else turn + 1
    return np.rint(place - within).astype(int)


def _floats(path: Path, name: str, values: Any, shape: tuple[int | None, ...]) -> np.ndarray:
    """Values as float64, of a shape in which None is any length; UnusableObject if they are not finite numbers."""
    try:
        array = np.asarray(values, dtype=np.float64)
        what = f"shape {array.shape}"
        fits = array.ndim == len(shape) and all(b in (None, a) for a, b in zip(array.shape, shape, strict=True))
    except (TypeError, ValueError):
        fits, what = False, "something else"
    if not fits:
        raise UnusableObject(f"{path}: {name}: expected numbers of shape {shape}, found {what}")
    if not np.isfinite(array).all():
        raise UnusableObject(f"{path}: {name}: not all finite")
    return array


def _reading(path: Path, name: str, gel: Any) -> np.ndarray:
    """A gel's image as ours: uint8, rows along the sensor's z."""
    values = _floats(path, name, gel, (RESOLUTION, RESOLUTION, 3))
    if values.min() < 0 or values.max() > 255:
        raise UnusableObject(f"{path}: {name}: values from {values.min():g} to {values.max():g}: expected 0 to 255")
    return np.rint(values).astype(np.uint8).transpose(1, 0, 2)


def read_empty_reading(root: Path | str) -> np.ndarray:
    """(100, 100, 3) uint8: what an untouched sensor reads; `empty_gel.npy`. Raises UnusableObject as `_reading`."""
    path = Path(root) / EMPTY_READING
    if not path.is_file():
        raise UnusableObject(f"{path}: no such file: copy it there from the `data` folder of the authors' repository")
    return _reading(path, "the empty gel", load_plain(path))


def orientation_agreement(touch: Mapping[str, np.ndarray], empty_reading: np.ndarray) -> tuple[float, float]:
    """Agreement of a record's readings with its depths, as they are and transposed; nan without touches: the share
    of pixels that differ from the empty reading where something is in range, and equal it elsewhere. If the second is
    larger over many objects, the axes of a gel's image, which the release does not document, are exchanged."""
    touched = touch["success"]
    if not touched.any():
        return float("nan"), float("nan")
    pressed = (touch["reading"][touched] != empty_reading).any(axis=-1)
    in_range = np.isfinite(touch["depth"][touched])
    return float((pressed == in_range).mean()), float((pressed.swapaxes(1, 2) == in_range).mean())


def read_vision(surface: Path, grasps: int, size: int) -> dict[str, np.ndarray]:
    """The record of the vision store, of the object with this surface: images (size, size, 3) uint8 of the paper's
    camera; no masks, no depths. Images are resized as by the authors' loader, and put over white. Raises
    UnusableObject, naming an unreadable file."""
    alone, *held = (_image(file_of(surface, IMAGES, f"{k}.png"), size) for k in ("unoccluded", *range(grasps)))
    return {"unoccluded": alone[None], "occluded": np.stack(held)[:, None], **matrices([paper_camera(size)])}


def _image(path: Path, size: int) -> np.ndarray:
    """An image (size, size, 3) uint8 over white. Raises UnusableObject for a file that can't be read."""
    try:
        with Image.open(path) as file:
            image = file.convert("RGBA")
    except OSError as error:
        raise UnusableObject(f"{path}: can't be read as an image ({error}): unpack it again") from None
    if image.size != (size, size):
        image = image.resize((size, size), Image.Resampling.BILINEAR)
    return np.asarray(Image.alpha_composite(Image.new("RGBA", image.size, "white"), image))[..., :3]
