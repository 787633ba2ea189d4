"""The touch sensor as plain data: its size, its grid of pixels, its frame, its gel and its lights.

Sensors are YAML files: those shipped are in `palpate/sensors`, others are named by their paths. A touch store has the
description of its own.

Sensor frame: the origin is the centre of the sensor plane, x points out of the gel, y along the columns and z along the
rows of the reading. Seen along +x, y is to the right and z is down: a reading with row 0 at the top is what the camera
behind the gel sees, not mirrored. On the hand, the gel's face is `gel_face` before the origin.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from palpate.configuration import ConfigError, check, read_yaml

SHIPPED = Path(__file__).with_name("sensors")
SCHEMA = SHIPPED / "schema.yaml"
# Keys that decide the shapes of a sensor's arrays and its points; the others decide how a reading looks.
GEOMETRY = ("width", "height", "resolution", "range", "gel_radius", "gel_face")
MATERIAL = ("thickness", "shear_modulus", "poisson")  # keys of a gel that can be pressed
Size = tuple[float, float]  # metres along z and y, in the order of rows and columns


@dataclass(frozen=True, eq=False)
class Sensor:
    """A touch sensor with a rectangular plane of pixels, metres; made by `load` or `from_description`."""

    name: str  # of its file
    width: float  # of the sensor plane, along y
    height: float  # of the sensor plane, along z
    resolution: tuple[int, int]  # (r, c), pixels along z and y: rows, columns
    range: float  # from the sensor plane to the undeformed gel, of a round gel to its apex
    gel_radius: float | None  # of the sphere that a round gel is a cap of; None: flat and as wide as the plane
    gel_face: float  # from the sensor plane to the face that the hand has there, at which contact stops it
    # One of three forms. A red, a green and a blue light: `angles` (degrees around the sensor's axis, from y to z),
    # `radius` and `height` (above the plane at `range`, towards the sensor plane). A list of lights, each with a
    # `colour` and a `position` (y, z, height) or a `direction` towards it. A table of colours over normals:
    # `colour_table`.
    lights: Mapping[str, Any] | Sequence[Mapping[str, Any]]
    diffuse: float  # lambda, grey levels of a surface that faces a light
    smoothing: Mapping[str, Any] | None = None  # `pyramid`, `last`, `held`: `palpate.touch.shading.smoothed`
    # (r, c, 3) uint8 image of the untouched gel; None: the shading of the undeformed gel.
    background: np.ndarray | None = field(default=None, repr=False)
    # What pressed readings need as well (docs/gel.md): `thickness`, `shear_modulus` and `poisson` of the gel, the size
    # of its face (as `size`), how far the middle of a convex face stands out over its corners, and dots on it.
    material: Mapping[str, float] | None = None
    gel_size: Size | None = None
    gel_sag: float = 0.0
    markers: Mapping[str, int] | None = None

    @property
    def size(self) -> Size:
        """Edges of the plane (height, width), in the order of `resolution`."""
        return self.height, self.width

    @property
    def pixel(self) -> Size:
        """Edges of a pixel, in the order of `resolution`."""
        return self.height / self.resolution[0], self.width / self.resolution[1]

    @cached_property
    def pixel_centres(self) -> tuple[np.ndarray, np.ndarray]:
        """Centres of the pixels on the sensor plane: z of the rows (r,) and y of the columns (c,)."""
        rows, columns = map(pixel_centres, self.resolution, self.size)
        return rows, columns

    @cached_property
    def plane(self) -> np.ndarray:
        """Positions (r, c, 3) of the pixels on the sensor plane, sensor frame."""
        z, y = np.meshgrid(*self.pixel_centres, indexing="ij")
        return np.stack([np.zeros_like(y), y, z], axis=2)

    @cached_property
    def _off_axis(self) -> np.ndarray:
        """Squared distances (r, c), m^2, of the pixels from the sensor's axis."""
        z, y = self.pixel_centres
        return z[:, None] ** 2 + y[None] ** 2

    @property
    def rim(self) -> float:
        """Radius of the circle that a round gel covers: as wide as the plane's shorter edge."""
        return min(self.width, self.height) / 2

    @cached_property
    def on_gel(self) -> np.ndarray:
        """Which pixels look at the gel, (r, c) bool: all, or those within the circle of a round one."""
        return np.full(self.resolution, True) if self.gel_radius is None else self._off_axis <= self.rim**2

    @cached_property
    def sag(self) -> np.ndarray:
        """Metres (r, c) that the undeformed gel is below its apex; beside a round gel as at its rim."""
        if self.gel_radius is None:
            return np.zeros(self.resolution)
        return self.gel_radius - np.sqrt(self.gel_radius**2 - np.minimum(self._off_axis, self.rim**2))

    @cached_property
    def face_sag(self) -> np.ndarray:
        """(r, c) metres that the face of the gel that is pressed lies below its middle: `sag`, or a convex face's."""
        if self.gel_radius or not self.gel_sag:
            return self.sag
        half = np.hypot(*(self.gel_size or self.size)) / 2
        radius = (half**2 + self.gel_sag**2) / (2 * self.gel_sag)
        return radius - np.sqrt(radius**2 - np.minimum(self._off_axis, half**2))

    @cached_property
    def reach(self) -> np.ndarray:
        """Metres (r, c) from the sensor plane within which a pixel touches: the undeformed gel; -inf beside it."""
        return np.where(self.on_gel, self.range - self.sag, -np.inf)

    @cached_property
    def lamps(self) -> list[tuple[np.ndarray, np.ndarray, bool]]:
        """The lights: place (y, z, height above the plane at `range`) in metres, or direction if it is far; colour, of
        which 1 is `diffuse` grey levels; whether it is far. None if there is a colour table."""
        if self.colour_table:
            return []
        lights: Any = self.lights
        if isinstance(lights, Mapping):
            angles, radius = np.deg2rad(lights["angles"]), lights["radius"]
            places = np.stack([radius * np.cos(angles), radius * np.sin(angles), np.full(3, lights["height"])], axis=1)
            lights = [{"position": place, "colour": colour} for place, colour in zip(places, np.eye(3), strict=True)]
        kinds = ["direction" if "direction" in light else "position" for light in lights]
        pairs = zip(lights, kinds, strict=True)
        return [(np.array(a[kind], float), np.array(a["colour"], float), kind == "direction") for a, kind in pairs]

    @property
    def colour_table(self) -> Mapping[str, Any] | None:
        """Colours over normals in place of lights, or None. `polynomial`: rows of red, green and blue, 1 for `diffuse`
        grey levels, of the monomials of degree 1 to `normal` in the normal's y and z, times those of degree 0 to
        `place` in the pixel's (-1 to 1 over the image). `steepest`: length of (y, z) beyond which the colour stays."""
        return self.lights if isinstance(self.lights, Mapping) and "polynomial" in self.lights else None

    @property
    def geometry(self) -> dict[str, Any]:
        """The attributes of `GEOMETRY`: all that grasps need."""
        return {key: getattr(self, key) for key in GEOMETRY}

    def description(self) -> dict[str, Any]:
        """The sensor as its file has it, for JSON; `background` is True if it has an image, else None."""
        shape = {"sag": self.gel_sag} if self.gel_sag else "flat"
        gel: dict[str, Any] = {"face": {"radius": self.gel_radius} if self.gel_radius else shape}
        gel |= {"size": list(self.gel_size)} if self.gel_size else {}
        return {
            **{"name": self.name, "width": self.width, "height": self.height, "resolution": list(self.resolution)},
            **{"range": self.range, "gel": gel | dict(self.material or {})},
            **({"markers": dict(self.markers)} if self.markers else {}),
            **{"gel_face": self.gel_face, "lights": self.lights, "diffuse": self.diffuse},
            "smoothing": self.smoothing and dict(self.smoothing),
            "background": True if self.background is not None else None,
        }

    @classmethod
    def from_description(
        cls,
        description: Mapping[str, Any],
        background: np.ndarray | None = None,
        what: str = "a sensor",
        schema: Path | None = SCHEMA,
    ) -> "Sensor":
        """The sensor of a description, as a file or a store has it; background: the untouched gel's image, used if it
        has one; what: name for messages. Raises `ConfigError` for what does not fit the schema, if there is one, an
        impossible gel or light."""
        if schema:
            check(dict(description), schema, what)
        values = {key: value for key, value in description.items() if key not in ("gel", "background")}
        resolution, gel = description["resolution"], description["gel"]
        face = {} if gel["face"] == "flat" else gel["face"]
        rows, columns = (resolution, resolution) if isinstance(resolution, int) else resolution
        values |= {
            "resolution": (rows, columns),
            "height": description.get("height", description["width"] * (rows / columns)),  # square pixels
            "gel_face": description.get("gel_face", 0.019273),  # of the DIGIT in the Allegro's tips
            "gel_radius": float(face["radius"]) if "radius" in face else None,
            "gel_sag": float(face.get("sag", 0)),
            "gel_size": tuple(map(float, gel["size"])) if "size" in gel else None,
            "material": {key: float(gel[key]) for key in MATERIAL} if "thickness" in gel else None,
        }
        sensor = cls(**values, background=background if description["background"] else None)
        if wrong := sensor.impossible():
            raise ConfigError(f"{what}: {wrong}")
        return sensor

    def impossible(self) -> str:
        """Why there can't be a gel or light as described; empty if there can."""
        if self.gel_radius is not None and self.gel_radius < self.rim:
            return f"gel.face.radius {self.gel_radius:g} m is less than half of width: the gel has to reach its rim"
        if not (self.range - self.sag > 0).all():
            return "the rim of the gel is behind the sensor plane: raise range, or gel.face.radius"
        for number, light in enumerate([] if isinstance(self.lights, Mapping) else self.lights):
            if ("position" in light) == ("direction" in light) or not np.any(light.get("direction", 1)):
                return f"lights.{number}: expected a position, or a direction that is not 0"
        if table := self.colour_table:
            count = (table["normal"] * (table["normal"] + 3) // 2) * ((table["place"] + 1) * (table["place"] + 2) // 2)
            if len(table["polynomial"]) != count:
                return f"lights.polynomial: expected {count} rows, got {len(table['polynomial'])}"
        if not all(far or place[2] >= self.range for place, _, far in self.lamps):
            return "lights.height must be range or more: no surface in range above the lights"
        return ""

    def require_material(self) -> Mapping[str, float]:
        """The gel's material. Raises `ConfigError` if the sensor's file does not describe a gel that can be pressed."""
        if self.material is None or self.gel_radius is not None:
            raise ConfigError(
                f"touch.pressed, press.count: the gel of sensor {self.name!r} can't be pressed: its file needs "
                "gel.thickness, gel.shear_modulus and gel.poisson, and a gel.face that is flat or {sag: m}"
            )
        return self.material

    def geometry_difference(self, other: "Sensor") -> str:
        """The values of `GEOMETRY` that differ from another sensor's, as text; empty if data of one fit the other."""
        mine, theirs = self.geometry, other.geometry
        return ", ".join(f"{key} {mine[key]} and {theirs[key]}" for key in GEOMETRY if mine[key] != theirs[key])


def pixel_centres(resolution: int, width: float) -> np.ndarray:
    """Centres (resolution,) of the pixels of a sensor `width` metres wide, along y or z."""
    return ((np.arange(resolution) + 0.5) / resolution - 0.5) * width


def sensor_file(sensor: str, folder: Path | str = ".") -> Path:
    """The file of a sensor: the name of a shipped one, or a path, absolute or from `folder`. Raises `ConfigError`."""
    known = shipped()
    path = SHIPPED / f"{sensor}.yaml" if sensor in known else Path(folder, sensor).expanduser()
    if not path.is_file():
        raise ConfigError(f"touch.sensor: {path}: no such file; sensors by name are {', '.join(known)}")
    return path


def shipped() -> list[str]:
    """Names of the sensors that come with the package."""
    return sorted(path.stem for path in SHIPPED.glob("*.yaml") if path != SCHEMA)


def read(path: Path, below: tuple[Path, ...] = ()) -> dict[str, Any]:
    """The keys of a sensor's file, and of the one that it extends (below: those that extend it); `background` as a path
    that can be opened. Raises `ConfigError`, naming the file, for one that can't be used, or that extends itself."""
    description = read_yaml(path)
    if not isinstance(description, dict):
        raise ConfigError(f"{path}: expected the keys of a sensor, as in {SHIPPED / 'digit.yaml'}")
    image, base = description.get("background"), description.pop("extends", None)
    for key, value in {"background": image, "extends": base}.items():
        if not isinstance(value, str | None):
            raise ConfigError(f"{path}: {key}: expected the path of a file, or null")
    if image:
        description["background"] = str(path.parent / image)
    if path.resolve() in below:
        raise ConfigError(f"{path}: extends itself")
    inherited = read(sensor_file(base, path.parent), (*below, path.resolve())) if base else {}
    return inherited | {"name": path.stem} | description


def read_background(path: Path | str, resolution: Sequence[int]) -> np.ndarray:
    """The image (r, c, 3) uint8 of an untouched gel, resized to resolution (r, c). Raises `ConfigError` if it can't be
    read."""
    rows, columns = resolution
    try:
        with Image.open(path) as picture:
            return np.asarray(picture.convert("RGB").resize((columns, rows), Image.Resampling.BILINEAR))
    except OSError as error:
        raise ConfigError(f"{path}: can't be read as the image of an untouched gel: {error}") from None


def load(sensor: str, folder: Path | str = ".") -> Sensor:
    """A sensor by its name or path (`sensor_file`). Raises `ConfigError`, naming the file, for an invalid one, or if
    its range does not reach the gel's face."""
    path = sensor_file(sensor, folder)
    description = read(path)
    image = description.get("background")
    kind = Sensor.from_description({**description, "background": None}, what=str(path))
    if kind.range < kind.gel_face:
        raise ConfigError(
            f"{path}: range {kind.range:g} m does not reach the gel's face on the hand, gel_face {kind.gel_face:g} m "
            "from the sensor plane: nothing could touch; raise range, or lower gel_face"
        )
    return replace(kind, background=read_background(image, kind.resolution)) if image else kind


# Without its schema: of most processes nothing else needs the package that reads it, which takes 0.1 s to be imported.
DIGIT = Sensor.from_description(read(SHIPPED / "digit.yaml"), schema=None)
