"""Closing with friction and a given force, on an object that is held or loose."""

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
    object press with `grip` N along the line between them, whatever the servos' gain. No gravity acts meanwhile.

    `sides` (s,), to be set before a closing, are those of the object that the sensors press: -1 or 1, 0 for none.
    """

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
        self.grip, self.loose, self.heavier = grip, loose, max(1.0, LEAST_MASS / body.mass)
        body = body._replace(mass=self.heavier * body.mass, inertia=self.heavier * body.inertia)
        super().__init__(hand, patches, body, friction, timestep, stiffness)
        model = self.model
        model.opt.impratio = IMPRATIO
        limit = STRONGEST * grip * np.where(hand.joint_slides[self._drivers], 1.0, ARM)
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
