"""Plain shapes put against one finger's pad, where it is known what touches."""

import mujoco
import numpy as np
import trimesh

from palpate.grasp.closing import GraspSimulation
from palpate.grasp.grasp import Grasper
from palpate.grasp.targets import PRESS
from studies.stability.watched import HAND, POINTS, Closing, Setting

FINGER = 1  # the middle finger: its sensor's number
BENT = (0.0, 0.5, 0.5, 0.4)  # rad, of its joints where it meets a shape
PAD = (0.010, 0.012)  # m, half extents of the gel pad
FACE = 0.0268  # m, width of the fingertip


def far() -> trimesh.Trimesh:
    """A ball that no finger reaches."""
    return trimesh.creation.icosphere(subdivisions=2, radius=0.02).apply_translation((0.5, 0, 0.1))


def louvre() -> tuple[trimesh.Trimesh, np.ndarray]:
    """Sheets 15 mm apart that face upwards, and points (N, 3) on the lowest one: no palm fits above it."""
    corners, faces = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [(0, 1, 2), (0, 2, 3)]
    sheet = trimesh.Trimesh(0.15 * np.array(corners), faces)
    sheets = [sheet.copy().apply_translation((0, 0, 0.015 * number)) for number in range(8)]
    points = np.random.default_rng(0).uniform(-0.02, 0.02, (100, 3)) * (1, 1, 0)
    return trimesh.util.concatenate(sheets), points


def plate(width: float = 0.06) -> trimesh.Trimesh:
    """The top is at z = 0, as with all shapes here; in its middle, or at its tip, is the origin."""
    return trimesh.creation.box((width, 0.06, 0.01)).apply_translation((0, 0, -0.005))


def ball() -> trimesh.Trimesh:
    return trimesh.creation.icosphere(subdivisions=4, radius=0.02).apply_translation((0, 0, -0.02))


def edge(along: bool) -> trimesh.Trimesh:
    """A prism of 60 degrees whose edge lies along the finger, or across."""
    corners = [(x, y, z) for x in (-0.03, 0.03) for y, z in ((0, 0), (0.0173, -0.03), (-0.0173, -0.03))]
    prism = trimesh.convex.convex_hull(np.array(corners))
    if along:
        prism.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (0, 0, 1)))
    return prism


def vertex() -> trimesh.Trimesh:
    """A pyramid whose edges make 67 degrees with each other at the tip."""
    corners = [(0, 0, 0), *((x, y, -0.03) for x in (-0.02, 0.02) for y in (-0.02, 0.02))]
    return trimesh.convex.convex_hull(np.array(corners))


def groove(half_angle: float, half_gap: float) -> trimesh.Trimesh:
    """Two walls along the finger, which open towards +z. half_gap: metres between them and z = 0's middle."""
    walls = []
    for side in (-1, 1):
        wall = trimesh.creation.box((0.01, 0.08, 0.1)).apply_translation((side * 0.005, 0, 0))
        wall.apply_transform(trimesh.transformations.rotation_matrix(side * half_angle, (0, 1, 0)))
        walls.append(wall.apply_translation((side * half_gap, 0, 0)))
    return trimesh.util.concatenate(walls)


def bent() -> np.ndarray:
    """Joint positions (J,) of the open hand with the middle finger bent."""
    joints = HAND.open_joint_positions.copy()
    joints[4 * FINGER : 4 * FINGER + 4] = BENT
    return joints


def crossed() -> np.ndarray:
    """Joint positions (J,) of index and middle finger turned into each other."""
    joints = HAND.open_joint_positions.copy()
    joints[[1, 5]] = 1.2
    joints[[0, 4]] = 0.25, -0.25
    return joints


def mass_at_pad(simulation: GraspSimulation) -> float:
    """What a push on the pad along its normal has to move, in kg; the palm is placed at the origin."""
    model, data = simulation.model, simulation.data
    position, rotation = HAND.sensor_frames(HAND.forward(np.eye(4), data.qpos))
    out, body = rotation[FINGER, :, 0], model.body(HAND.link_names[HAND.sensor_link[FINGER]]).id
    jacobian, inertia = np.zeros((3, model.nv)), np.zeros((model.nv, model.nv))
    mujoco.mj_jac(model, data, jacobian, None, position[FINGER] + reach() * out, body)
    mujoco.mj_fullM(model, data, inertia)
    along = out @ jacobian
    return float(1 / (along @ np.linalg.solve(inertia, along)))


def facing(shape: trimesh.Trimesh, joints: np.ndarray, deep: float = PRESS, at=(0.0, 0.0)) -> trimesh.Trimesh:
    """The shape with its origin `deep` m behind the pad's face, z out of the shape, x across the finger.

    joints: (J,) of a hand whose palm is at the origin. at: m from the pad's middle, across and along the
    finger.
    """
    position, rotation = HAND.sensor_frames(HAND.forward(np.eye(4), joints))
    out, across, up = rotation[FINGER].T
    place = np.eye(4)
    place[:3, :3] = np.column_stack([across, -up, -out])
    place[:3, 3] = position[FINGER] + (reach() - deep) * out + at[0] * across + at[1] * up
    return shape.copy().apply_transform(place)


def reach() -> float:
    """Metres from the sensor's origin to the face of its gel."""
    on_tip = HAND.geom_link == HAND.sensor_link[FINGER]
    faces = HAND.geom_position[on_tip, 0] + HAND.geom_size[on_tip, 0]
    return float(faces.max() - HAND.sensor_position[FINGER, 0])


def alone(mesh: trimesh.Trimesh, targets: np.ndarray | None = None) -> Setting:
    """A shape as the object, and one closing: the palm at the origin, the middle finger bending."""
    points = trimesh.sample.sample_surface(mesh, POINTS, seed=0)[0]
    targets = bent() if targets is None else targets
    return Setting(Grasper(mesh, mesh, points, HAND), [Closing(np.eye(4), targets)])
