"""Closing with friction and a given force, on an object that is held or loose."""

from collections.abc import Iterator

import mujoco
import numpy as np

from palpate.grasp.closing import RAMP
from palpate.grasp.hold import Body, HoldSimulation
from palpate.grasp.targets import sensor_joints
from palpate.hand import Hand
from palpate.hand.model import ARM, STIFFNESS

GAIN = 10 * STIFFNESS  # N m / rad: the object's weight moves the hand's servos by millimetres at most
GRIPPED = 0.95  # share of the duration in which the grip grows and follows the fingers; then servos hold
UPDATE = 5  # time steps after which the servos' targets follow the fingers
STRONGEST = 4.0  # of the servos' limit, over the grip (of hinges at `ARM`): a driver may move two jaws
IMPRATIO = 100  # friction's stiffness over the normal's: with 1, what is gripped askew creeps by millimetres a second
LEAST_MASS = 0.05  # kg, about a jaw's: fingers sink into lighter objects, whose contacts are as soft as they are light
DRAG = 0.01  # s in which a loose object loses its speed while the hand closes, as if it lay on a table


class GripSimulation(HoldSimulation):
    """A `HoldSimulation` whose closing ends with a given force: the fingers of each of the two sides that touch the
    object press with `grip` N along the line between them, whatever the servos' gain. No gravity acts meanwhile."""

    def __init__(
        self,
        hand: Hand,
        patches: list[np.ndarray],
        body: Body,
        friction: float,
        timestep: float,
        grip: float,
        loose: bool = True,
        stiffness: float = GAIN,
    ):
        """grip: N. loose: whether the object can move. Others as for `HoldSimulation`."""
        self.grip, self.loose = grip, loose
        self.heavier = max(1.0, LEAST_MASS / body.mass)
        body = body._replace(mass=self.heavier * body.mass, inertia=self.heavier * body.inertia)
        super().__init__(hand, patches, body, friction, timestep, stiffness)
        self.model.opt.impratio = IMPRATIO
        model = self.model
        slides = hand.joint_slides[self._drivers]
        limit = STRONGEST * grip * np.where(slides, 1.0, ARM)
        model.actuator_forcerange[:] = np.stack([-limit, limit], axis=-1)
        self._gain = model.actuator_gainprm[:, 0]
        self.sides = np.zeros(len(hand.sensor_link), dtype=int)  # the side of the object of each sensor; 0: of none
        self._moves = (sensor_joints(hand) @ (hand.joint_driver[:, None] == hand.joint_driver))[:, hand.drivers]
        self.link_body = np.array([model.body(hand.link_names[link]).id for link in hand.sensor_link])
        self._gel = hand.sensor_position + hand.contact_distance()[:, None] * hand.sensor_rotation[:, :, 0]
        inertia = np.repeat([model.body_mass[self._object], model.body_inertia[self._object].mean()], 3)
        self._drag = np.append(model.dof_damping[: len(hand.joint_link)], inertia / DRAG)[: model.nv]
        self._no_drag = model.dof_damping.copy()

    def weight(self, gravity: np.ndarray) -> np.ndarray:
        """As `HoldSimulation.weight`: the object's own weight, on a body that may be heavier."""
        return gravity / self.heavier

    @property
    def object_pose(self) -> np.ndarray:
        """As `GraspSimulation.object_pose`; of a loose object where it has moved to."""
        if not self.loose:
            return np.eye(4)
        pose, rotation = np.eye(4), np.zeros(9)  # not `xpos`, which after a step is that before it
        mujoco.mju_quat2Mat(rotation, self.data.qpos[-4:])
        pose[:3, :3], pose[:3, 3] = rotation.reshape(3, 3), self.data.qpos[-7:-4]
        return pose

    def closing(self, targets: np.ndarray) -> Iterator[mujoco.MjData]:
        """As `GraspSimulation.closing`; in the second part the servos' targets go beyond the fingers by as much as
        the grip takes."""
        model, data = self.model, self.data
        model.opt.gravity, model.dof_damping[:] = np.zeros(3), self._drag
        start, targets = data.qpos[self._joints][self._drivers], targets[self._drivers]
        begin, end = round(RAMP * self.steps), round(GRIPPED * self.steps)
        for step, share in enumerate(self.ramp):
            if step < begin:
                data.ctrl[:] = start + share * (targets - start)
            elif step < end and (step - begin) % UPDATE == 0:
                self._press(min(1.0, 2 * (step - begin + UPDATE) / (end - begin)))
            mujoco.mj_step(model, data)
            yield data
        model.dof_damping[:] = self._no_drag

    def _press(self, share: float) -> None:
        """Set the servos' targets so that they press with this share of the grip."""
        model, data = self.model, self.data
        touched = np.zeros(model.nbody, dtype=bool)
        bodies = model.geom_bodyid[data.contact.geom].reshape(-1, 2)
        touched[bodies[(bodies == self._object).any(axis=1)]] = True
        press = np.flatnonzero((self.sides != 0) & touched[self.link_body])
        bodies = self.link_body[press]
        rotation, sides = data.xmat[bodies].reshape(-1, 3, 3), self.sides[press]
        gels = data.xpos[bodies] + (rotation @ self._gel[press, :, None])[..., 0]
        if not {-1, 1} <= set(sides):
            return
        ends = [gels[sides == side].mean(axis=0) for side in (-1, 1)]
        along = (ends[1] - ends[0]) / max(np.linalg.norm(ends[1] - ends[0]), 1e-9)
        joints, torques, jacobian = data.qpos[self._joints], np.zeros(model.nv), np.zeros((3, model.nv))
        for body, gel, side in zip(bodies, gels, sides, strict=True):
            mujoco.mj_jac(model, data, jacobian, None, gel, body)
            torques -= share * self.grip / (sides == side).sum() * side * along @ jacobian
        beyond = torques[: len(joints)] @ self.hand.follow_slopes(joints)
        pressing = self._moves[press].any(axis=0)
        data.ctrl[pressing] = (joints[self._drivers] + beyond[self._drivers] / self._gain)[pressing]
