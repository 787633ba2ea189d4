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

# Index, middle, ring: (y, z, roll) of the finger's base in the palm frame; the index finger is next to the
# thumb.
FINGERS = (("index", -0.0435, -0.00154, 0.0873), ("middle", 0.0, 0.0007, 0.0), ("ring", 0.0435, -0.00154, -0.0873))
# Of every finger's links: (offset along z from the link before, joint axis, range, half extents, centre's z).
FINGER_LINKS = (
    (0.0, (0, 0, 1), (-0.47, 0.47), (0.0098, 0.01375, 0.0082), 0.0082),
    (0.0164, (0, 1, 0), (-0.196, 1.61), (0.0098, 0.01375, 0.0270), 0.0270),
    (0.0540, (0, 1, 0), (-0.174, 1.709), (0.0098, 0.01375, 0.0192), 0.0192),
    (0.0384, (0, 1, 0), (-0.227, 1.618), (0.0098, 0.01375, 0.00735), 0.00735),
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
    links, joints, geoms = [], [], []

    def add_link(name, parent, position, rotation, joint=None) -> int:
        links.append((name, parent, position, rotation))
        if joint is not None:
            joints.append((len(links) - 1, *joint))
        return len(links) - 1

    def add_box(link, centre, half_extents, colour) -> None:
        geoms.append((link, centre, half_extents, colour))

    def add_tip(name, parent, offset) -> int:
        tip = add_link(f"{name}_tip", parent, (0, 0, offset), np.eye(3))
        for bounds, colour in ((DIGIT_BODY, DIGIT_COLOUR), (GEL_PAD, GEL_COLOUR)):
            low, high = np.array(bounds).T
            add_box(tip, (low + high) / 2, (high - low) / 2, colour)
        return tip

    palm = add_link("palm", -1, (0, 0, 0), np.eye(3))
    for (low_y, high_y), (low_z, high_z) in PALM_BOXES:
        low, high = np.array([PALM_BACK, low_y, low_z]), np.array([PALM_FACE, high_y, high_z])
        add_box(palm, (low + high) / 2, (high - low) / 2, LINK_COLOUR)

    tips = []
    for name, y, z, roll in FINGERS:
        link = palm
        for number, (offset, axis, limits, half_extents, centre) in enumerate(FINGER_LINKS):
            at_base = number == 0
            position = (0, y, z) if at_base else (0, 0, offset)
            rotation = roll_pitch_yaw(roll, 0, 0) if at_base else np.eye(3)
            link = add_link(f"{name}_{number}", link, position, rotation, (axis, limits))
            add_box(link, (0, 0, centre), half_extents, LINK_COLOUR)
        tips.append(add_tip(name, link, FINGER_TIP_OFFSET))

    link = palm
    for number, (position, rpy, axis, limits, centre, half_extents) in enumerate(thumb_links()):
        link = add_link(f"thumb_{number}", link, position, roll_pitch_yaw(*rpy), (axis, limits))
        add_box(link, centre, half_extents, LINK_COLOUR)
    tips.append(add_tip("thumb", link, THUMB_TIP_OFFSET))

    anchor = np.eye(4)
    anchor[:3, 3] = (PALM_FACE, 0, PALM_ANCHOR_HEIGHT)
    count = len(geoms)
    return Hand(
        name="allegro",
        link_names=tuple(link[0] for link in links),
        link_parent=np.array([link[1] for link in links]),
        link_position=np.array([link[2] for link in links], dtype=float),
        link_rotation=np.array([link[3] for link in links], dtype=float),
        joint_link=np.array([joint[0] for joint in joints]),
        joint_axis=np.array([joint[1] for joint in joints], dtype=float),
        joint_slides=np.zeros(len(joints), dtype=bool),
        joint_range=np.array([joint[2] for joint in joints], dtype=float),
        geom_link=np.array([geom[0] for geom in geoms]),
        geom_kind=("box",) * count,
        geom_size=np.array([geom[2] for geom in geoms], dtype=float),
        geom_position=np.array([geom[1] for geom in geoms], dtype=float),
        geom_rotation=np.tile(np.eye(3), (count, 1, 1)),
        geom_rgba=np.array([geom[3] for geom in geoms], dtype=float),
        geom_collides=np.ones(count, dtype=bool),
        geom_vertices=(np.zeros((0, 3)),) * count,
        geom_faces=(np.zeros((0, 3), dtype=int),) * count,
        sensor_names=("index", "middle", "ring", "thumb"),
        sensor_thumb=np.array([False, False, False, True]),
        sensor_link=np.array(tips),
        sensor_position=np.tile(SENSOR_ORIGIN + np.array([DIGIT.gel_face - gel_face, 0, 0]), (4, 1)),
        sensor_rotation=np.tile(np.eye(3), (4, 1, 1)),
        open_joint_positions=np.array([0.0] * 12 + list(OPEN_THUMB)),
        palm_anchor=anchor,
    )


def thumb_links() -> tuple:
    """Thumb links: place and roll, pitch, yaw in the one before; axis, range; box centre, half extents."""
    return (
        (
            (-0.0182, -0.019333, -0.045987),
            (0, -1.658, 1.5708),
            (1, 0, 0),
            (0.263, 1.396),
            (-0.0179, -0.009, 0.0145),
            (0.0179, 0.0170, 0.02275),
        ),
        ((-0.027, -0.005, 0.0399), (0, 0, 0), (0, 0, -1), (-0.105, 1.163), (0, 0, 0.00885), (0.0098, 0.01375, 0.00885)),
        ((0, 0, 0.0177), (0, 0, 0), (0, 1, 0), (-0.189, 1.644), (0, 0, 0.0257), (0.0098, 0.01375, 0.0257)),
        ((0, 0, 0.0514), (0, 0, 0), (0, 1, 0), (-0.162, 1.719), (0, 0, 0.01515), (0.0098, 0.01375, 0.01515)),
    )


def roll_pitch_yaw(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """The rotation matrix of roll, pitch and yaw about fixed x, y and z axes (the URDF convention).

    scipy's `Rotation` rounds otherwise: stored hands would change in their last bit.
    """
    about_x, about_y, about_z = rotation_about(np.eye(3), np.array([roll, pitch, yaw]))
    return about_z @ about_y @ about_x
