"""The Allegro hand with DIGIT touch sensors as fingertips, from its kinematics in `allegro.yaml`.

Palm frame: +x the palm's normal (towards the object), +z along the fingers; the thumb is at -y. Metres, radians.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import ArrayLike

from palpate.hand.hand import Hand, rotation_about
from palpate.sensor import DIGIT


def allegro(gel_face: float = DIGIT.gel_face) -> Hand:
    """The Allegro hand with four DIGITs: 16 joints, four each of index, middle, ring finger and thumb; gel_face: m from
    the sensor frame to the gel's face, of another sensor in the DIGIT's place."""
    given = yaml.safe_load(Path(__file__).with_name("allegro.yaml").read_text(encoding="utf-8"))
    links: list[tuple] = [("palm", -1, (0, 0, 0), np.eye(3))]
    joints: list[tuple] = []
    geoms: list[tuple] = []
    sensors: list[tuple] = []

    def add_box(link: int, centre: ArrayLike, half_extents: ArrayLike, colour: str) -> None:
        no_mesh = np.zeros((0, 3)), np.zeros((0, 3), dtype=int)
        geoms.append((link, "box", half_extents, centre, np.eye(3), given["colours"][colour], True, *no_mesh))

    def add_between(link: int, bounds: Sequence[Sequence[float]], colour: str) -> None:
        low, high = np.transpose(bounds)
        add_box(link, (low + high) / 2, (high - low) / 2, colour)

    palm = given["palm"]
    for box in palm["boxes"]:
        add_between(0, [palm["x"], *box], "link")
    sensor_position = given["sensor"] + np.array([DIGIT.gel_face - gel_face, 0, 0])
    for name, finger in given["fingers"].items():
        link = 0
        for number, phalanx in enumerate(finger["links"]):
            # Roll, pitch and yaw about fixed axes, as in a URDF. scipy's rounds otherwise: stored hands would change.
            x, y, z = rotation_about(np.eye(3), np.array(phalanx["turn"]))
            links.append((f"{name}_{number}", link, phalanx["position"], z @ y @ x))
            link = len(links) - 1
            joint = len(joints)
            joints.append((link, phalanx["axis"], False, phalanx["range"], links[link][0], joint, (0, 1, 0, 0, 0)))
            add_box(link, phalanx["centre"], phalanx["half_extents"], "link")
        links.append((f"{name}_tip", link, (0, 0, finger["tip"]), np.eye(3)))
        tip = len(links) - 1
        add_between(tip, given["digit"], "digit")
        add_between(tip, given["gel"], "gel")
        sensors.append((name, name == "thumb", tip, sensor_position, np.eye(3)))

    anchor = np.eye(4)
    anchor[:3, 3] = (palm["x"][1], 0, palm["anchor_height"])
    return Hand.from_rows("allegro", links, joints, geoms, sensors, given["open"], anchor)
