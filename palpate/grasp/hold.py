"""Whether a hand keeps what it grasps: the object is let go, with friction, under gravity along six directions in turn.

A second simulation, which changes no grasp: a closing has a held object and no friction.
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import mujoco
import numpy as np
import trimesh

from palpate.grasp.closing import GraspSimulation
from palpate.grasp.contacts import Contacts, contacts, on_object
from palpate.grasp.frames import kept_closings
from palpate.grasp.grasp import Grasper
from palpate.grasp.patches import surface_patches
from palpate.grasp.quality import cone_margin, wrench_radius
from palpate.hand import Hand
from palpate.hand.model import STIFFNESS
from palpate.mesh import OBJECT_POSITION

GRAVITY = 9.81  # m / s^2
DIRECTIONS = np.concatenate([np.eye(3), -np.eye(3)])  # +x, +y, +z, -x, -y, -z of the world
RESTED = 0.1  # s in which forces come to rest
CONDIM = 3  # contacts resist sliding; turning only as far as there are several


class Body(NamedTuple):
    """Mass and inertia of a body of uniform density."""

    mass: float  # kg
    centre: np.ndarray  # (3,) m, of mass, in the object's own frame
    inertia: np.ndarray  # (3, 3) kg m^2, about the centre
    solid: bool  # of the volume that the mesh encloses, not of a convex hull


def body_of(mesh: trimesh.Trimesh, density: float) -> Body:
    """The object as a body. density: kg / m^3.

    Its volume is what the mesh encloses if it is closed, and else the convex hull of its `surface_patches`, which are
    thick where a mesh is flat.
    """
    solid = bool(mesh.is_volume)
    volume = mesh if solid else trimesh.convex.convex_hull(np.concatenate(surface_patches(mesh)))
    return Body(float(density * volume.volume), volume.center_mass, density * volume.moment_inertia, solid)


class HoldSimulation(GraspSimulation):
    """A `GraspSimulation` with a free object and friction. Gravity pulls the object only: servos would carry the hand.

    Friction cones are elliptic: with pyramids a contact resists less along their diagonals.
    """

    loose, heavier = True, 1.0  # whether the object can move; of the simulated mass, over the object's

    def __init__(
        self,
        hand: Hand,
        patches: list[np.ndarray],
        body: Body,
        friction: float,
        timestep: float,
        stiffness: float = STIFFNESS,
    ):
        """body, friction (the coefficient of all contacts): of the object; others as for `GraspSimulation`."""
        self.body, self.friction = body, friction
        super().__init__(hand, patches, timestep, stiffness=stiffness)

    def specification(self) -> mujoco.MjSpec:
        """Hand and object as for a closing, with the object's weight and friction."""
        spec = super().specification()
        spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        spec.compiler.balanceinertia = True  # of a thin plate, the sum of two moments may miss the third by rounding
        for geom in spec.geoms:
            geom.condim, geom.friction = CONDIM, [self.friction, 0, 0]
        for body in spec.bodies:
            body.gravcomp = 1
        free, inertia = spec.body("object"), self.body.inertia
        if self.loose:
            free.add_freejoint()
        free.gravcomp, free.explicitinertial = 0, True
        free.mass, free.ipos = self.body.mass, self.body.centre
        free.fullinertia = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        return spec

    @property
    def object_pose(self) -> np.ndarray:
        """As `GraspSimulation.object_pose`; of a loose object where it has moved to."""
        pose, rotation = np.eye(4), np.zeros(9)
        if self.loose:  # not `xpos`, which after a step is that before it
            mujoco.mju_quat2Mat(rotation, self.data.qpos[-4:])
            pose[:3, :3], pose[:3, 3] = rotation.reshape(3, 3), self.data.qpos[-7:-4]
        return pose

    def set_forces(self, gravity: np.ndarray, damping: np.ndarray | float = 0.0) -> None:
        """Let the object's weight be that of `gravity` (3,), m / s^2, and damp its six velocities."""
        self.model.opt.gravity = gravity / self.heavier
        self.model.dof_damping[self._joints.stop :] = damping

    def moved(
        self,
        palm_pose: np.ndarray,
        joint_positions: np.ndarray,
        targets: np.ndarray,
        gravity: np.ndarray,
        duration: float,
        distance: float,
    ) -> float:
        """The largest distance of the object's centre of mass from its place, m; NaN if the engine warned.

        It starts at rest in the hand at `palm_pose` (4, 4) and `joint_positions` (J,), whose servos hold `targets`
        (J,). gravity: (3,) m / s^2. Ends after `duration` s, or once it is farther than `distance` m.
        """
        model, data = self.model, self.data
        self.set_forces(gravity)
        self.place(palm_pose, joint_positions)
        data.ctrl[:] = targets[self._drivers]
        start, farthest = data.xipos[self._object].copy(), 0.0
        for _ in range(round(duration / model.opt.timestep) + 1):  # after a step, `xipos` is still that before it
            mujoco.mj_step(model, data)
            farthest = max(farthest, float(np.linalg.norm(data.xipos[self._object] - start)))
            if farthest > distance:
                break
        # A NaN resets the state silently; only the warnings tell.
        warned = any(warning.number for warning in data.warning) or not np.isfinite(data.qpos).all()
        return np.nan if warned else farthest

    def pressed(self, palm_pose: np.ndarray, joint_positions: np.ndarray, targets: np.ndarray) -> Contacts:
        """The contacts with the object without gravity, `RESTED` s after the start of `moved`."""
        self.set_forces(np.zeros(3))
        self.place(palm_pose, joint_positions)
        self.data.ctrl[:] = targets[self._drivers]
        mujoco.mj_step(self.model, self.data, round(RESTED / self.model.opt.timestep))
        return on_object(contacts(self))


def held_poses(
    grasper: Grasper, kept: Mapping[str, np.ndarray], rng: np.random.Generator, remedy: str = ""
) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Of each of an object's kept grasps number, palm pose (4, 4) and servos' targets (J,) at rest, in the object's own
    frame; arguments as for `hold_grasps`."""
    if "servo_positions" not in kept:
        yield from kept_closings(grasper, kept, rng, remedy)
        return
    poses = kept["palm_pose"].copy()
    poses[:, :3, 3] -= OBJECT_POSITION
    yield from zip(range(len(poses)), poses, kept["servo_positions"], strict=True)


def hold_grasps(
    grasper: Grasper,
    collision: trimesh.Trimesh,
    kept: Mapping[str, np.ndarray],
    rng: np.random.Generator,
    friction: float,
    density: float,
    distance: float,
    duration: float,
    remedy: str = "",
) -> dict[str, np.ndarray]:
    """Whether each of an object's g kept grasps holds it, by the names that the contract has for the arrays.

    grasper, kept, rng, remedy: as for `closing_frames`. collision: the object's decimated mesh. friction: the
    coefficient of all contacts. density: kg / m^3. An object that stays within `distance` m for `duration` s is held.
    The simulation of a direction ends at `distance`: dropped objects cost little.

    Raises DamagedFile, with the remedy, if a placement of a kept grasp is not drawn again.
    """
    simulation = grasper.loose_simulation
    if simulation is None:
        body = body_of(collision, density)
        simulation = HoldSimulation(grasper.hand, grasper.patches, body, friction, grasper.timestep)
    length = np.linalg.norm(collision.vertices - simulation.body.centre, axis=1).max()
    moved = np.full((len(kept["palm_pose"]), len(DIRECTIONS)), np.nan)
    radius, margin = np.zeros((2, len(moved)))
    for number, pose, targets in held_poses(grasper, kept, rng, remedy):
        at_rest = pose, kept["joint_positions"][number], targets
        moved[number] = [simulation.moved(*at_rest, GRAVITY * axis, duration, distance) for axis in DIRECTIONS]
        pressed = simulation.pressed(*at_rest)
        radius[number] = wrench_radius(pressed, friction, simulation.body.centre, length)
        margin[number] = cone_margin(pressed, friction)
    simulated = ~np.isnan(moved)
    held = np.where(simulated, moved <= distance, -1)
    return {
        "held": np.where(simulated.all(axis=1), held.min(axis=1), -1),
        "held_along": held,
        "moved": np.where(simulated, moved, np.inf),
        "mass": np.array(simulation.model.body("object").mass[0] / simulation.heavier),
        "solid": np.array(simulation.body.solid),
        "wrench_radius": radius,
        "cone_margin": margin,
    }
