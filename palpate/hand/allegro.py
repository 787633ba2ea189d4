"""The Allegro hand with DIGIT touch sensors as fingertips, from its kinematics.

Palm frame: +x the palm's normal (towards the object), +z along the fingers; the thumb is at -y. Metres,
radians.

The kinematics, limits and link boxes are those of Wonik's published description of the hand. The sensor's place
and range are those of the paper's published assets. Two boxes of the description are replaced. Its fingertip is
misplaced. Its palm is one box, which jams the thumb in 44 % of configurations.
"""

import numpy as np

from palpate.hand.hand import Hand, rotation_about
from palpate.sensor import DIGIT

LINK_COLOUR = (0.10, 0.10, 0.11, 1.0)
DIGIT_COLOUR = (0.18, 0.18, 0.20, 1.0)
GEL_COLOUR = (0.85, 0.85, 0.80, 1.0)

# The face of the palm: its x is where gaps to the object are measured from.
PALM_FACE = 0.0113
PALM_BACK = -0.0295
PALM_ANCHOR_HEIGHT = 0.02  # between the palm's middle and the finger tips: what the palm is aimed with
# The palm is C-shaped, for the thumb's root sits in a cut-out: (low y, high y), (low z, high z).
PALM_BOXES = (
    ((-0.0567, 0.0567), (-0.030, 0.0)),
    ((-0.050, 0.050), (-0.047, -0.030)),
    ((0.0, 0.048), (-0.095, -0.047)),
    ((-0.030, 0.0), (-0.095, -0.081)),
)

# (y, z, roll) of the finger's base in the palm frame; the index finger is next to the thumb.
FINGERS = (("index", -0.0435, -0.00154, 0.0873), ("middle", 0.0, 0.0007, 0.0), ("ring", 0.0435, -0.00154, -0.0873))
# Of every finger's links: (offset along z from the link before, joint axis, range, half extents, centre's z).
FINGER_LINKS = (
    (0.0, (0, 0, 1), (-0.47, 0.47), (0.0098, 0.01375, 0.0082), 0.0082),
    (0.0164, (0, 1, 0), (-0.196, 1.61), (0.0098, 0.01375, 0.0270), 0.0270),
    (0.0540, (0, 1, 0), (-0.174, 1.709), (0.0098, 0.01375, 0.0192), 0.0192),
    (0.0384, (0, 1, 0), (-0.227, 1.618), (0.0098, 0.01375, 0.00735), 0.00735),
)
# Of the thumb's: place and roll, pitch, yaw in the link before; axis, range; half extents and centre of the box.
THUMB_LINKS = (
    ((-0.0182, -0.019333, -0.045987), (0, -1.658, 1.5708), (1, 0, 0), (0.263, 1.396))
    + ((0.0179, 0.0170, 0.02275), (-0.0179, -0.009, 0.0145)),
    ((-0.027, -0.005, 0.0399), (0, 0, 0), (0, 0, -1), (-0.105, 1.163), (0.0098, 0.01375, 0.00885), (0, 0, 0.00885)),
    ((0, 0, 0.0177), (0, 0, 0), (0, 1, 0), (-0.189, 1.644), (0.0098, 0.01375, 0.0257), (0, 0, 0.0257)),
    ((0, 0, 0.0514), (0, 0, 0), (0, 1, 0), (-0.162, 1.719), (0.0098, 0.01375, 0.01515), (0, 0, 0.01515)),
)
FINGER_TIP_OFFSET = 0.0147
THUMB_TIP_OFFSET = 0.0303

# The DIGIT in the tip frame: body, and the gel pad raised on it, as (low, high) of x, y, z. With one plain
# box in the place of both, touch success falls from 0.63 to 0.54.
DIGIT_BODY = ((-0.0116, 0.0150), (-0.0134, 0.0134), (0.0005, 0.0347))
GEL_PAD = ((0.0100, 0.0182), (-0.0100, 0.0100), (0.0051, 0.0291))
SENSOR_ORIGIN = (-0.001073, 0.0, 0.017119)  # of the DIGIT: 19.3 mm behind the gel

# Fingers straight, the thumb to the side at the end of its range: clear of flat objects too.
OPEN_THUMB = (0.263, 0.0, 0.0, 0.0)


def allegro(gel_face: float = DIGIT.gel_face) -> Hand:
    """The Allegro hand with four DIGITs: 16 joints, four each of index, middle, ring finger and thumb.

    gel_face: m from the sensor frame to the gel's face, of another sensor in the DIGIT's place.
    """
    links, joints, geoms = [("palm", -1, (0, 0, 0), np.eye(3))], [], []

    def add_box(link, centre, half_extents, colour) -> None:
        no_mesh = np.zeros((0, 3)), np.zeros((0, 3), dtype=int)
        geoms.append((link, "box", half_extents, centre, np.eye(3), colour, True, *no_mesh))

    def add_between(link, low, high, colour) -> None:
        low, high = np.array(low), np.array(high)
        add_box(link, (low + high) / 2, (high - low) / 2, colour)

    for (low_y, high_y), (low_z, high_z) in PALM_BOXES:
        add_between(0, (PALM_BACK, low_y, low_z), (PALM_FACE, high_y, high_z), LINK_COLOUR)
    fingers = [(name, finger_links(y, z, roll), FINGER_TIP_OFFSET) for name, y, z, roll in FINGERS]
    sensors, sensor_position = [], SENSOR_ORIGIN + np.array([DIGIT.gel_face - gel_face, 0, 0])
    for name, finger, tip_offset in (*fingers, ("thumb", THUMB_LINKS, THUMB_TIP_OFFSET)):
        link = 0
        for number, (position, rpy, axis, limits, half_extents, centre) in enumerate(finger):
            links.append((f"{name}_{number}", link, position, roll_pitch_yaw(*rpy)))
            link = len(links) - 1
            joints.append((link, axis, False, limits))
            add_box(link, centre, half_extents, LINK_COLOUR)
        links.append((f"{name}_tip", link, (0, 0, tip_offset), np.eye(3)))
        tip = len(links) - 1
        add_between(tip, *np.transpose(DIGIT_BODY), DIGIT_COLOUR)
        add_between(tip, *np.transpose(GEL_PAD), GEL_COLOUR)
        sensors.append((name, name == "thumb", tip, sensor_position, np.eye(3)))

    anchor = np.eye(4)
    anchor[:3, 3] = (PALM_FACE, 0, PALM_ANCHOR_HEIGHT)
    return Hand.from_rows("allegro", links, joints, geoms, sensors, [0.0] * 12 + list(OPEN_THUMB), anchor)


def finger_links(y: float, z: float, roll: float) -> list[tuple]:
    """Rows as of `THUMB_LINKS` for a finger whose base is at (y, z), turned by `roll`."""
    base, next_ones = ((0, y, z), (roll, 0, 0)), [((0, 0, row[0]), (0, 0, 0)) for row in FINGER_LINKS[1:]]
    return [(*place, *row[1:4], (0, 0, row[4])) for place, row in zip([base, *next_ones], FINGER_LINKS, strict=True)]


def roll_pitch_yaw(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """The rotation matrix of roll, pitch and yaw about fixed x, y and z axes (the URDF convention).

    scipy's `Rotation` rounds otherwise: stored hands would change in their last bit.
    """
    about_x, about_y, about_z = rotation_about(np.eye(3), np.array([roll, pitch, yaw]))
    return about_z @ about_y @ about_x
