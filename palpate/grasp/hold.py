"""Simulations of a hand with friction, about an object that may be loose: whether the hand keeps it when gravity pulls
along six directions in turn, and a closing with a given grip."""

from typing import NamedTuple

import mujoco
import numpy as np
import trimesh

from palpate.grasp.closing import RAMP, GraspSimulation
from palpate.grasp.contacts import Contacts, contacts, on_object
from palpate.grasp.patches import surface_patches
from palpate.grasp.targets import sensor_joints
from palpate.hand import Hand
from palpate.hand.model import ARM, STIFFNESS

GRAVITY = 9.81  # m / s^2
DIRECTIONS = np.concatenate([np.eye(3), -np.eye(3)])  # +x, +y, +z, -x, -y, -z of the world
RESTED = 0.1  # s in which forces come to rest

# Of a grip.
GAIN = 10 * STIFFNESS  # N m / rad: the object's weight moves the hand's servos by millimetres at most
GRIPPED = 0.95  # share of the duration in which the grip grows and follows the fingers; then servos hold
UPDATE = 5  # time steps after which the servos' targets follow the fingers
FORCE_LIMIT = 4.0  # largest force of a servo, in grips; of a hinge, at `ARM` from its axis. A servo may move two jaws
LEAST_MASS = 0.05  # kg, about a jaw's: fingers sink into lighter objects, whose contacts are as soft as they are light
DRAG = 0.01  # s in which a loose object loses its speed while the hand closes, as if it lay on a table


class Body(NamedTuple):
    """Mass and inertia of a body of uniform density."""

    mass: float  # kg
    centre: np.ndarray  # (3,) m, of mass, in the object's own frame
    inertia: np.ndarray  # (3, 3) kg m^2, about the centre
    solid: bool  # of the volume that the mesh encloses, not of a convex hull


def body_of(mesh: trimesh.Trimesh, density: float, patches: list[np.ndarray] | None = None) -> Body:
    """The object as a body; density: kg / m^3. Its volume is what the mesh encloses if it is closed, and else the
    convex hull of its `surface_patches`, which are thick where a mesh is flat. patches: those, if they are made."""
    solid = bool(mesh.is_volume)
    volume = mesh if solid else trimesh.convex.convex_hull(np.concatenate(patches or surface_patches(mesh)))
    return Body(float(density * volume.volume), volume.center_mass, density * volume.moment_inertia, solid)


class HoldSimulation(GraspSimulation):
    """A `GraspSimulation` with a free object and friction. Gravity pulls the object only: servos would carry the hand.
    Friction cones are elliptic: with pyramids a contact resists less along their diagonals."""

    loose, heavier = True, 1.0  # whether the object can move; of the simulated mass, over the object's

    def __init__(
        self, hand: Hand, patches: list[np.ndarray], body: Body, friction: float, timestep: float, **more: float
    ):
        """body, friction (the coefficient of all contacts): of the object; others as for `GraspSimulation`."""
        self.body, self.friction = body, friction
        super().__init__(hand, patches, timestep, **more)

    def specification(self) -> mujoco.MjSpec:
        """Hand and object as for a closing, with the object's weight and friction."""
        spec = super().specification()
        spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        spec.compiler.balanceinertia = True  # of a thin plate, the sum of two moments may miss the third by rounding
        for geom in spec.geoms:
            geom.condim, geom.friction = 3, [self.friction, 0, 0]  # contacts resist sliding
        for body in spec.bodies:
            body.gravcomp = 1
        free, inertia = spec.body("object"), self.body.inertia
        if self.loose:
            free.add_freejoint()
        free.gravcomp, free.explicitinertial = 0, True
        free.mass, free.ipos = self.body.mass, self.body.centre
        free.fullinertia = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        return spec

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
        """The largest distance (m) of the object's centre of mass from its place, within `duration` s or until it
        exceeds `distance` m, from rest in the hand at these poses (4, 4) and (J,), servos holding `targets` (J,); NaN
        if the engine warned."""
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


class GripSimulation(HoldSimulation):
    """A `HoldSimulation` whose closing ends with a given force: the fingers of each of the two sides that touch the
    object press with `grip` N along the line between them, whatever the servos' gain. No gravity acts meanwhile.
    `sides` (s,), to be set before a closing, are those of the object that the sensors press: -1 or 1, 0 for none."""

    def __init__(
        self, hand: Hand, patches: list, body: Body, *args: float, grip: float, loose: bool = True, **more: float
    ):
        """grip: N. loose: whether the object can move. Others as for `HoldSimulation`; stiffness: by default `GAIN`."""
        self.grip, self.loose, self.heavier = grip, loose, max(1.0, LEAST_MASS / body.mass)
        body = body._replace(mass=self.heavier * body.mass, inertia=self.heavier * body.inertia)
        super().__init__(hand, patches, body, *args, **{"stiffness": GAIN, **more})
        model = self.model
        model.opt.impratio = 100  # friction's stiffness over the normal's: with 1, what is gripped askew creeps
        limit = FORCE_LIMIT * grip * np.where(hand.joint_slides[self._drivers], 1.0, ARM)
        model.actuator_forcerange[:] = np.stack([-limit, limit], axis=-1)
        self._moves = sensor_joints(hand) @ (hand.joint_driver[:, None] == hand.joint_driver)[:, hand.drivers]
        self._drag = np.repeat([model.body_mass[self._object], model.body_inertia[self._object].mean()], 3) / DRAG

    def specification(self) -> mujoco.MjSpec:
        """As `HoldSimulation.specification`, with the gels as sites."""
        spec, hand = super().specification(), self.hand
        gels = hand.sensor_position + hand.contact_distance()[:, None] * hand.sensor_rotation[:, :, 0]
        for link, gel in zip(hand.sensor_link, gels, strict=True):
            spec.body(hand.link_names[link]).add_site(pos=gel)
        return spec

    def steer(self, step: int, aim: np.ndarray) -> None:
        """As `GraspSimulation.steer`; in the second part of a closing the servos' targets go beyond the fingers by as
        much as the grip takes."""
        begin, end = round(RAMP * self.steps), round(GRIPPED * self.steps)
        if step == 0:
            self.set_forces(np.zeros(3), self._drag[: 6 * self.loose])
        if step < begin:
            super().steer(step, aim)
        elif step < end and (step - begin) % UPDATE == 0:
            self._press(min(1.0, 2 * (step - begin + UPDATE) / (end - begin)))

    def _press(self, share: float) -> None:
        """Set the servos' targets so that they press with this share of the grip."""
        model, data = self.model, self.data
        bodies = model.geom_bodyid[data.contact.geom].reshape(-1, 2)
        touching = bodies[(bodies == self._object).any(axis=1)]
        press = np.flatnonzero((self.sides != 0) & np.isin(model.site_bodyid, touching))
        sides, gels = self.sides[press], data.site_xpos[press]
        if not {-1, 1} <= set(sides):
            return
        along = gels[sides == 1].mean(axis=0) - gels[sides == -1].mean(axis=0)
        along /= max(np.linalg.norm(along), 1e-9)
        joints, torques, jacobian = data.qpos[self._joints], np.zeros(model.nv), np.zeros((3, model.nv))
        for gel, side in zip(press, sides, strict=True):
            mujoco.mj_jacSite(model, data, jacobian, None, gel)
            torques -= share * self.grip / (sides == side).sum() * side * along @ jacobian
        beyond = (torques[: len(joints)] @ self.hand.follow_slopes(joints))[self._drivers]
        pressing = self._moves[press].any(axis=0)
        data.ctrl[pressing] = (joints[self._drivers] + beyond / model.actuator_gainprm[:, 0])[pressing]
