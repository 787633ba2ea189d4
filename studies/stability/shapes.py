"""Simple shapes placed against one finger's pad, so that the contact is known."""

import numpy as np
import trimesh

from palpate.grasp.grasp import Grasper
from palpate.grasp.targets import PRESS
from studies.grasping import Closing
from studies.stability.closings import HAND, POINTS, ClosingSetup

FINGER = 1  # the middle finger: its sensor's number
BENT_JOINTS = (0.0, 0.5, 0.5, 0.4)  # rad, of its joints where it meets a shape
PAD_HALF_EXTENTS = (0.010, 0.012)  # m, half extents of the gel pad


def distant_ball() -> trimesh.Trimesh:
    """A ball that no finger reaches."""
    return trimesh.creation.icosphere(subdivisions=2, radius=0.02).apply_translation((0.5, 0, 0.1))


def plate(width: float = 0.06) -> trimesh.Trimesh:
    """A plate whose top is at z = 0, with the origin in its middle, as for all shapes here."""
    return trimesh.creation.box((width, 0.06, 0.01)).apply_translation((0, 0, -0.005))


def edge() -> trimesh.Trimesh:
    """A prism with an edge of 60 degrees, across the finger."""
    corners = [(x, y, z) for x in (-0.03, 0.03) for y, z in ((0, 0), (0.0173, -0.03), (-0.0173, -0.03))]
    return trimesh.convex.convex_hull(np.array(corners))


def vertex() -> trimesh.Trimesh:
    """A pyramid whose opposite faces meet at 67 degrees at its tip."""
    corners = [(0, 0, 0), *((x, y, -0.03) for x in (-0.02, 0.02) for y in (-0.02, 0.02))]
    return trimesh.convex.convex_hull(np.array(corners))


def groove(half_angle: float, half_gap: float) -> trimesh.Trimesh:
    """Two walls along the finger that open towards +z. half_gap: metres from each wall to the middle, at z = 0."""
    walls = []
    for side in (-1, 1):
        wall = trimesh.creation.box((0.01, 0.08, 0.1)).apply_translation((side * 0.005, 0, 0))
        wall.apply_transform(trimesh.transformations.rotation_matrix(side * half_angle, (0, 1, 0)))
        walls.append(wall.apply_translation((side * half_gap, 0, 0)))
    return trimesh.util.concatenate(walls)


def bent_finger() -> np.ndarray:
    """Joint positions (J,) of the open hand with the middle finger bent."""
    joints = HAND.open_joint_positions.copy()
    joints[4 * FINGER : 4 * FINGER + 4] = BENT_JOINTS
    return joints


def placed_at_pad(shape: trimesh.Trimesh, joints: np.ndarray, deep: float = PRESS, at=(0.0, 0.0)) -> trimesh.Trimesh:
    """The shape with its origin `deep` m behind the pad's face, its z axis towards the pad, its x across the finger.

    joints: (J,) of a hand whose palm is at the origin. at: m from the pad's middle, across and along the
    finger.
    """
    position, rotation = HAND.sensor_frames(HAND.forward(np.eye(4), joints))
    out, across, up = rotation[FINGER].T
    place = np.eye(4)
    place[:3, :3] = np.column_stack([across, -up, -out])
    place[:3, 3] = position[FINGER] + (gel_distance() - deep) * out + at[0] * across + at[1] * up
    return shape.copy().apply_transform(place)


def gel_distance() -> float:
    """Metres from the sensor's origin to the face of its gel."""
    on_tip = HAND.geom_link == HAND.sensor_link[FINGER]
    faces = HAND.geom_position[on_tip, 0] + HAND.geom_size[on_tip, 0]
    return float(faces.max() - HAND.sensor_position[FINGER, 0])


def shape_setup(mesh: trimesh.Trimesh, targets: np.ndarray | None = None) -> ClosingSetup:
    """A setup with a shape as the object and one closing: the palm at the origin, the middle finger bending."""
    points = trimesh.sample.sample_surface(mesh, POINTS, seed=0)[0]
    targets = bent_finger() if targets is None else targets
    return ClosingSetup(Grasper(mesh, mesh, points, HAND), [Closing(np.eye(4), targets)])
