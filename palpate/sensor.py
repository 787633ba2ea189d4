"""The touch sensor as plain data: its size, its grid of pixels, its frame, its gel and its lights.

Sensors are YAML files: those shipped are in `palpate/sensors`, any other is named by its path. A touch store carries
the one that its readings are of, so that the data explain themselves.

Sensor frame: the origin is the centre of the sensor plane, x points out of the gel, y along the columns and z
along the rows of the reading. Seen from the sensor's inside, along +x, y is to the right and z is down, so a
reading with row 0 at the top is what the camera behind the gel sees, not mirrored.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from PIL import Image

from palpate.configuration import ConfigError, check

SHIPPED = Path(__file__).with_name("sensors")
SCHEMA = SHIPPED / "schema.yaml"
# Of a sensor's description: what decides the shapes of its arrays, and where its points can lie.
GEOMETRY = ("width", "resolution", "range", "gel")


@dataclass(frozen=True, eq=False)
class Sensor:
    """A touch sensor with a square plane of pixels, metres; made by `load` or `from_description`.

    Attributes:
        name: of its file.
        width: edge of the sensor plane. resolution: r, pixels along an edge.
        range: distance from the sensor plane to the undeformed gel, of a round gel to its apex.
        gel_radius: of the sphere that a round gel is a cap of; None if the gel is flat and as wide as the plane.
        lights: `angles` (degrees, of the red, green and blue light around the sensor's axis, from y to z), their
            `radius` and their `height` above the plane at `range`, towards the sensor plane.
        diffuse: lambda, grey levels of a surface that faces a light.
        smoothing: of the gel, or None: `pyramid`, `last`, `held`; see `palpate.touch.shading.smoothed`.
        background: (r, r, 3) uint8 image of the untouched gel; None: the shading of the undeformed gel.
    """

    name: str
    width: float
    resolution: int
    range: float
    gel_radius: float | None
    lights: Mapping[str, Any]
    diffuse: float
    smoothing: Mapping[str, Any] | None = None
    background: np.ndarray | None = field(default=None, repr=False)

    @property
    def pixel(self) -> float:
        """Edge of a pixel, metres."""
        return self.width / self.resolution

    @cached_property
    def pixel_centres(self) -> np.ndarray:
        """(r,) centres of the pixels on the sensor plane: y of the columns, and z of the rows."""
        return pixel_centres(self.resolution, self.width)

    @cached_property
    def plane(self) -> np.ndarray:
        """(r, r, 3) the pixels on the sensor plane, sensor frame."""
        y, z = np.meshgrid(self.pixel_centres, self.pixel_centres)
        return np.stack([np.zeros_like(y), y, z], axis=2)

    @cached_property
    def on_gel(self) -> np.ndarray:
        """(r, r) bool, pixels that look at the gel: all, or those within the circle of a round one."""
        square = self.pixel_centres[:, None] ** 2 + self.pixel_centres[None] ** 2
        return np.full(square.shape, True) if self.gel_radius is None else square <= (self.width / 2) ** 2

    @cached_property
    def sag(self) -> np.ndarray:
        """(r, r) metres that the undeformed gel lies below its apex; beside a round gel as at its rim."""
        if self.gel_radius is None:
            return np.zeros((self.resolution, self.resolution))
        square = self.pixel_centres[:, None] ** 2 + self.pixel_centres[None] ** 2
        return self.gel_radius - np.sqrt(self.gel_radius**2 - np.minimum(square, (self.width / 2) ** 2))

    @cached_property
    def reach(self) -> np.ndarray:
        """(r, r) metres from the sensor plane within which a pixel touches: the undeformed gel; -inf beside it."""
        return np.where(self.on_gel, self.range - self.sag, -np.inf)

    @cached_property
    def light_positions(self) -> np.ndarray:
        """(3, 3) of the red, green and blue light: (y, z, height above the plane at `range`), metres."""
        angles = np.deg2rad(self.lights["angles"])
        radius, height = self.lights["radius"], self.lights["height"]
        return np.stack([radius * np.cos(angles), radius * np.sin(angles), np.full(3, height)], axis=1)

    def description(self) -> dict[str, Any]:
        """The sensor as its file has it, for JSON; of a background image only that there is one."""
        return {
            "name": self.name,
            "width": self.width,
            "resolution": self.resolution,
            "range": self.range,
            "gel": "flat" if self.gel_radius is None else {"radius": self.gel_radius},
            "lights": dict(self.lights),
            "diffuse": self.diffuse,
            "smoothing": self.smoothing and dict(self.smoothing),
            "background": True if self.background is not None else None,
        }

    @classmethod
    def from_description(
        cls, description: Mapping[str, Any], background: np.ndarray | None = None, what: str = "a sensor"
    ) -> "Sensor":
        """The sensor of a description, as a file or a store has it.

        background: the image of the untouched gel, if the description says that there is one. what: it is called in
        messages. Raises `ConfigError` for a description that does not fit `palpate/sensors/schema.yaml`, or a gel that
        can't be.
        """
        check(dict(description), SCHEMA, what)
        values = {key: value for key, value in description.items() if key not in ("gel", "background")}
        gel = description["gel"]
        radius = None if gel == "flat" else float(gel["radius"])
        if radius is not None and radius < description["width"] / 2:
            raise ConfigError(
                f"{what}: gel.radius {radius:g} m is less than half of width: the gel has to reach its rim"
            )
        sensor = cls(**values, gel_radius=radius, background=background if description["background"] else None)
        if not (sensor.range - sensor.sag > 0).all():
            raise ConfigError(f"{what}: the rim of the gel is behind the sensor plane: raise range, or gel.radius")
        if not sensor.lights["height"] >= sensor.range:
            raise ConfigError(f"{what}: lights.height must be range or more: no surface in range above the lights")
        return sensor

    def misfit(self, other: "Sensor") -> str:
        """In what the geometry of another sensor differs, as words; empty if data of one fit the other."""
        mine, theirs = self.description(), other.description()
        return ", ".join(f"{key} {mine[key]} and {theirs[key]}" for key in GEOMETRY if mine[key] != theirs[key])


def pixel_centres(resolution: int, width: float) -> np.ndarray:
    """(resolution,) centres of the pixels of a sensor `width` metres wide, along y or z."""
    return ((np.arange(resolution) + 0.5) / resolution - 0.5) * width


def sensor_file(sensor: str, folder: Path | str = ".") -> Path:
    """The file of a sensor, by a name of those shipped or a path, absolute or from `folder`.

    Raises `ConfigError`, naming those shipped, if there is none.
    """
    known = shipped()
    path = SHIPPED / f"{sensor}.yaml" if sensor in known else Path(folder, sensor).expanduser()
    if not path.is_file():
        raise ConfigError(f"touch.sensor: {path}: no such file; sensors by name are {', '.join(known)}")
    return path


def shipped() -> list[str]:
    """Names of the sensors that come with the package."""
    return sorted(path.stem for path in SHIPPED.glob("*.yaml") if path != SCHEMA)


def read(path: Path) -> dict[str, Any]:
    """The keys of a sensor's file. Raises `ConfigError`, naming it, if it can't be read or has none."""
    try:
        description = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: can't be read as YAML: {error}") from None
    if not isinstance(description, dict):
        raise ConfigError(f"{path}: expected the keys of a sensor, as in {SHIPPED / 'digit.yaml'}")
    return description


def background_file(path: Path) -> Path | None:
    """The image of the untouched gel that a sensor's file names, from its folder; None if it names none.

    Raises `ConfigError` as `read` does, and for something else than a path.
    """
    image = read(path).get("background")
    if not isinstance(image, str | None):
        raise ConfigError(f"{path}: background: expected the path of an image, or null")
    return path.parent / image if image else None


def read_background(path: Path | str, resolution: int) -> np.ndarray:
    """(resolution, resolution, 3) uint8 image of an untouched gel, resized. Raises `ConfigError` if it is none."""
    try:
        with Image.open(path) as picture:
            return np.asarray(picture.convert("RGB").resize((resolution, resolution), Image.Resampling.BILINEAR))
    except OSError as error:
        raise ConfigError(f"{path}: can't be read as the image of an untouched gel: {error}") from None


def load(sensor: str, folder: Path | str = ".") -> Sensor:
    """A sensor by a name of those shipped, or the path of its file; see `sensor_file`.

    Raises `ConfigError`, naming the file, for one that can't be read or does not fit.
    """
    path = sensor_file(sensor, folder)
    found = Sensor.from_description({**read(path), "background": None}, what=str(path))
    image = background_file(path)
    return replace(found, background=read_background(image, found.resolution)) if image else found


DIGIT = load("digit")
