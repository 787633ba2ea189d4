"""Simple shapes placed against one finger's pad, so that the contact is known."""

import mujoco
import numpy as np
import trimesh

from palpate.grasp.closing import GraspSimulation
from palpate.grasp.grasp import Grasper
from palpate.grasp.targets import PRESS
from studies.grasping import Closing
from studies.stability.closings import HAND, POINTS, ClosingSetup

FINGER = 1  # the middle finger: its sensor's number
BENT_JOINTS = (0.0, 0.5, 0.5, 0.4)  # rad, of its joints where it meets a shape
PAD_HALF_EXTENTS = (0.010, 0.012)  # m, half extents of the gel pad
FINGERTIP_WIDTH = 0.0268  # m, width of the fingertip


def distant_ball() -> trimesh.Trimesh:
    """A ball that no finger reaches."""
    return trimesh.creation.icosphere(subdivisions=2, radius=0.02).apply_translation((0.5, 0, 0.1))


def narrow_sheets() -> tuple[trimesh.Trimesh, np.ndarray]:
    """Parallel sheets 15 mm apart, facing upwards, and points (N, 3) on the lowest; no palm fits between them."""
    corners, faces = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [(0, 1, 2), (0, 2, 3)]
    sheet = trimesh.Trimesh(0.15 * np.array(corners), faces)
    sheets = [sheet.copy().apply_translation((0, 0, 0.015 * number)) for number in range(8)]
    points = np.random.default_rng(0).uniform(-0.02, 0.02, (100, 3)) * (1, 1, 0)
    return trimesh.util.concatenate(sheets), points


def plate(width: float = 0.06) -> trimesh.Trimesh:
    """A plate whose top is at z = 0, with the origin in its middle, as for all shapes here."""
    return trimesh.creation.box((width, 0.06, 0.01)).apply_translation((0, 0, -0.005))


def ball() -> trimesh.Trimesh:
    return trimesh.creation.icosphere(subdivisions=4, radius=0.02).apply_translation((0, 0, -0.02))


def edge(along: bool) -> trimesh.Trimesh:
    """A prism with an edge of 60 degrees, along the finger or across it."""
    corners = [(x, y, z) for x in (-0.03, 0.03) for y, z in ((0, 0), (0.0173, -0.03), (-0.0173, -0.03))]
    prism = trimesh.convex.convex_hull(np.array(corners))
    if along:
        prism.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (0, 0, 1)))
    return prism


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


def crossed_fingers() -> np.ndarray:
    """Joint positions (J,) of index and middle finger turned into each other."""
    joints = HAND.open_joint_positions.copy()
    joints[[1, 5]] = 1.2
    joints[[0, 4]] = 0.25, -0.25
    return joints


def mass_at_pad(simulation: GraspSimulation) -> float:
    """Effective mass (kg) of the hand at the pad, along the pad's normal; the palm is at the origin."""
    model, data = simulation.model, simulation.data
    position, rotation = HAND.sensor_frames(HAND.forward(np.eye(4), data.qpos))
    out, body = rotation[FINGER, :, 0], model.body(HAND.link_names[HAND.sensor_link[FINGER]]).id
    jacobian, inertia = np.zeros((3, model.nv)), np.zeros((model.nv, model.nv))
    mujoco.mj_jac(model, data, jacobian, None, position[FINGER] + gel_distance() * out, body)
    mujoco.mj_fullM(model, data, inertia)
    along = out @ jacobian
    return float(1 / (along @ np.linalg.solve(inertia, along)))


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
