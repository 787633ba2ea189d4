"""A scene: one object, the hand in its grasps, sensors, a camera and lights. Plain data: no engine is imported.
Touch and vision read it. Everything is in the world frame: metres, z up."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from palpate.batch import generator
from palpate.camera import Camera, euler_rotation, looking_at, paper_camera
from palpate.configuration import ConfigError
from palpate.hand.hand import Hand
from palpate.mesh import OBJECT_POSITION, mesh_file

# What a scene takes from a store of grasps, by the names there.
GRASP_ARRAYS = ("link_pose", "sensor_position", "sensor_rotation")


@dataclass(frozen=True)
class Light:
    """A light of a scene."""

    kind: str  # `sun` (parallel), `point` (a sphere), `area` (a square, to one side), or `ambient` (from everywhere)
    energy: float  # of a sun W / m2, of a point or an area W; of an ambient light its radiance, of which 1 is white
    position: tuple[float, float, float] | None = None  # world, m; of a sun just the direction from the target counts
    target: tuple[float, float, float] | None = None  # that a sun or an area shines at; None: the object's place
    size: float = 0.0  # of a sun its extent in degrees, of a point its radius and of an area its side in m
    colour: tuple[float, float, float] = (1.0, 1.0, 1.0)  # sRGB in 0..1, by which the energy is multiplied


# A sun from the paper camera's upper left, without extent: its shadows are sharp and free of noise. A white diffuse
# surface (albedo 0.8) that faces it has 0.8 * (2.1 / pi + 0.45) = 0.9 of white.
LIGHTS = (Light("sun", 2.1, (0.6, -0.55, 1.9)), Light("ambient", 0.45))
WHITE = (1.0, 1.0, 1.0)
# What lights have besides kind, energy and colour.
LIGHT_KEYS = {
    "sun": ("position", "target", "size"),
    "point": ("position", "size"),
    "area": ("position", "target", "size"),
    "ambient": (),
}


@dataclass(frozen=True, eq=False)
class Scene:
    """One object, alone or in g grasps of a hand with L links and s touch sensors; ValueError for poses without it."""

    object_folder: Path  # its mesh files; `visual.glb` is what is touched and seen
    hand: Hand | None = None  # None if the object is alone
    link_pose: np.ndarray = field(default_factory=lambda: np.zeros((0, 0, 4, 4)))  # (g, L, 4, 4)
    sensor_position: np.ndarray = field(default_factory=lambda: np.zeros((0, 0, 3)))  # (g, s, 3)
    # (g, s, 3, 3), columns are the frame's axes.
    sensor_rotation: np.ndarray = field(default_factory=lambda: np.zeros((0, 0, 3, 3)))
    object_position: tuple[float, float, float] = OBJECT_POSITION  # of the origin of the object's own frame
    camera: Camera = field(default_factory=paper_camera)
    lights: tuple[Light, ...] = LIGHTS
    background: tuple[float, float, float] | None = WHITE  # behind all, sRGB in 0..1; None is transparent

    def __post_init__(self) -> None:
        object.__setattr__(self, "object_folder", Path(self.object_folder))
        if self.hand is None and len(self.link_pose):
            raise ValueError(f"{len(self.link_pose)} link poses without a hand: give the hand they are of")

    @classmethod
    def from_grasps(
        cls, object_folder: Path | str, grasps: Mapping[str, np.ndarray], hand: Hand, **others: Any
    ) -> "Scene":
        """The scene of an object and its stored grasps: `GRASP_ARRAYS` (g, ...) each; others: further attributes."""
        return cls(Path(object_folder), hand, **({name: grasps[name] for name in GRASP_ARRAYS} | others))

    @property
    def name(self) -> str:
        return self.object_folder.name

    @property
    def visual_file(self) -> Path:
        """The object's geometry and materials, in its own frame; raises as `palpate.mesh.mesh_file` does."""
        return mesh_file(self.object_folder, "visual.glb")


LOOK = ("cameras", "lights", "background")  # keys of the config's section `vision` whose numbers may be ranges
DRAWS = 100  # of cameras and lights that have to be possible


def draw(settings: Mapping[str, Any], seed: int, name: str) -> dict[str, Any]:
    """The config's section `vision` for one object: for each range `{from, to}` a uniform number from it. Numbers
    depend on the seed, the object's name and the key (`LOOK`) only. Impossible cameras or lights are drawn again.
    Raises ConfigError if `from` is above `to`, or if `DRAWS` draws in turn are impossible."""
    for attempt in count():
        drawn = dict(settings)
        for key in LOOK:
            rng = generator(seed, name, "vision", key, str(attempt))
            drawn[key] = _drawn(settings[key], rng, f"config vision.{key}")
        try:
            cameras(drawn), lights(drawn)
            break
        except ConfigError:
            if attempt == DRAWS - 1 or drawn == settings:
                raise
    return drawn


def _drawn(value: Any, numbers: np.random.Generator, where: str) -> Any:
    """A part of the config with a number for each range, drawn in the order of keys and elements."""
    if isinstance(value, list):
        return [_drawn(item, numbers, f"{where}.{place}") for place, item in enumerate(value)]
    if not isinstance(value, Mapping):
        return value
    if "from" not in value:
        return {key: _drawn(value[key], numbers, f"{where}.{key}") for key in sorted(value)}
    if value["from"] > value["to"]:
        raise ConfigError(f"{where}: from {value['from']} is above to {value['to']}: exchange them")
    return float(numbers.uniform(value["from"], value["to"]))


def _place(position: Sequence[float] | Mapping[str, float], target: Sequence[float]) -> tuple[float, ...]:
    """A position of the config, m: `[x, y, z]`, or azimuth from x to y, elevation and distance from the target."""
    if not isinstance(position, Mapping):
        return tuple(position)
    azimuth, elevation = np.radians([position["azimuth"], position["elevation"]])
    away = np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)
    return tuple(np.add(target, position["distance"] * np.array(away)).tolist())


def cameras(settings: Mapping[str, Any]) -> list[Camera]:
    """The cameras of the config's section `vision`: the paper's, or those that it lists. Raises ConfigError, naming the
    camera, for missing or contradicting keys, or if its image misses the object's place."""
    given, size = settings["cameras"], settings["size"]
    listed = [_camera(f"config vision.cameras.{number}", keys, size) for number, keys in enumerate(given or ())]
    return listed if given is not None else [paper_camera(size)]


def _camera(where: str, settings: Mapping[str, Any], size: int) -> Camera:
    """A camera that the config lists; where: its place in the config, for messages."""
    if ("target" in settings) == ("rotation" in settings):
        raise ConfigError(f"{where}: give either `target`, the point that it looks at, or `rotation`")
    if "focal_length" in settings and "field_of_view" in settings:
        raise ConfigError(f"{where}: give `focal_length` or `field_of_view`, not both")
    if "up" in settings and "target" not in settings:
        raise ConfigError(f"{where}: `up` belongs to `target`: a rotation says where up is")
    position = np.array(_place(settings["position"], settings.get("target", OBJECT_POSITION)), dtype=float)
    if "rotation" in settings:
        rotation = euler_rotation(settings["rotation"])
    else:
        try:
            rotation = looking_at(settings["target"], position, up=settings.get("up", (0.0, 0.0, 1.0))).rotation
        except ValueError as error:
            raise ConfigError(f"{where}: {error}") from None
    focal_length = settings.get("focal_length", paper_camera(size).focal_length)
    if "field_of_view" in settings:
        focal_length = size / 2 / math.tan(math.radians(settings["field_of_view"]) / 2)
    camera = Camera(position, rotation, float(focal_length), size)
    (column, row), depth = camera.project(np.array(OBJECT_POSITION))
    if not (depth > 0 and 0 <= column <= size and 0 <= row <= size):
        raise ConfigError(f"{where}: the object's place {OBJECT_POSITION} is not in its image: turn or move it")
    return camera


def lights(settings: Mapping[str, Any]) -> tuple[Light, ...]:
    """The lights of the config's section `vision`: `LIGHTS`, or those that it lists. Raises ConfigError, naming the
    light, for missing keys, or keys that its kind does not have."""
    if settings["lights"] is None:
        return LIGHTS
    listed = []
    for number, given in enumerate(settings["lights"]):
        where, kind = f"config vision.lights.{number}", given["kind"]
        keys = LIGHT_KEYS[kind]
        if unknown := sorted(set(given) - {"kind", "energy", "colour", *keys}):
            raise ConfigError(f"{where}: light of kind {kind} has no {', '.join(unknown)}")
        if "position" in keys and "position" not in given:
            raise ConfigError(f"{where}: light of kind {kind} needs a position")
        if kind == "area" and not given.get("size"):
            raise ConfigError(f"{where}: light of kind area needs a size above 0, its side in m")
        target = given.get("target", OBJECT_POSITION)
        attributes: dict[str, Any] = dict(given)
        attributes |= {key: tuple(value) for key, value in given.items() if isinstance(value, list)}
        if "position" in keys:
            attributes["position"] = _place(given["position"], target)
        if "target" in keys and np.array_equal(attributes["position"], target):
            raise ConfigError(f"{where}: its position is its target: no direction to shine in")
        listed.append(Light(**attributes))
    return tuple(listed)


def look(settings: Mapping[str, Any]) -> dict[str, Any]:
    """The lights and the background of the config's section `vision`, as a scene has them; raises as `lights`."""
    background = settings["background"]
    return {"lights": lights(settings), "background": None if background == "transparent" else tuple(background)}
