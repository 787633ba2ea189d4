"""A scene: one object, the hand in its grasps, sensors, a camera and lights. Plain data: no engine is imported.

Touch and vision read it. Everything is in the world frame: metres, z up.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from palpate.camera import Camera, paper_camera
from palpate.hand.hand import Hand
from palpate.mesh import OBJECT_POSITION, mesh_file

# What a scene takes from a store of grasps, by the names there.
GRASP_ARRAYS = ("link_pose", "sensor_position", "sensor_rotation")


@dataclass(frozen=True)
class Lights:
    """One lamp, a sun of no extent, and a constant ambient light.

    A white diffuse surface (albedo 0.8) that faces the lamp comes out at 0.8 * (strength / pi + ambient) = 0.9
    of white.

    Attributes:
        direction: (3,) from the object towards the lamp; the default is the camera's upper left.
        strength: of the lamp, W / m2. ambient: radiance of the ambient light, 1 is white.
    """

    direction: tuple[float, float, float] = (0.6, -0.55, 1.3)
    strength: float = 2.1
    ambient: float = 0.45


@dataclass(frozen=True, eq=False)
class Scene:
    """One object, alone or in g grasps of a hand with L links and s touch sensors.

    Attributes:
        object_folder: the object's mesh files; `visual.glb` is what is touched and seen.
        object_position: (3,) of the origin of the object's own frame.
        hand: None if the object is alone; link_pose: (g, L, 4, 4) of its links.
        sensor_position: (g, s, 3), sensor_rotation: (g, s, 3, 3) of the sensors; columns are the frame's axes.
        camera, lights: what an image is made with.

    Raises ValueError for poses of links without a hand.
    """

    object_folder: Path
    hand: Hand | None = None
    link_pose: np.ndarray = field(default_factory=lambda: np.zeros((0, 0, 4, 4)))
    sensor_position: np.ndarray = field(default_factory=lambda: np.zeros((0, 0, 3)))
    sensor_rotation: np.ndarray = field(default_factory=lambda: np.zeros((0, 0, 3, 3)))
    object_position: tuple[float, float, float] = OBJECT_POSITION
    camera: Camera = field(default_factory=paper_camera)
    lights: Lights = Lights()

    def __post_init__(self) -> None:
        object.__setattr__(self, "object_folder", Path(self.object_folder))
        if self.hand is None and len(self.link_pose):
            raise ValueError(f"{len(self.link_pose)} link poses without a hand: give the hand they are of")

    @classmethod
    def from_grasps(
        cls, object_folder: Path | str, grasps: Mapping[str, np.ndarray], hand: Hand, **others: Any
    ) -> "Scene":
        """The scene of an object and its stored grasps.

        grasps: `GRASP_ARRAYS` of this object, (g, ...) each. hand: the one that they are of. others: further
        attributes of the scene.
        """
        return cls(object_folder, hand, **{name: grasps[name] for name in GRASP_ARRAYS}, **others)

    @property
    def name(self) -> str:
        """The object's name: that of its folder."""
        return self.object_folder.name

    @property
    def visual_file(self) -> Path:
        """The object's geometry and materials, in its own frame; raises as `palpate.mesh.mesh_file` does."""
        return mesh_file(self.object_folder, "visual.glb")
