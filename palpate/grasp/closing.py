"""Closing the hand in MuJoCo: position targets ramp up while contact with the object stops the fingers."""

import itertools
import logging
from collections.abc import Collection, Iterator
from typing import NamedTuple

import mujoco
import numpy as np

from palpate.hand import DURATION, Hand
from palpate.hand.model import STIFFNESS, build_spec, quaternion

TIMESTEP = 0.004  # s
RAMP = 0.4  # share of the duration in which the targets move from the open hand to their end
ITERATIONS = 20  # of the contact solver; fewer than 5 are too few
# MuJoCo's contact impedance (dmin, dmax, width, midpoint, power), with which fingers stop within 0.5 mm.
SOLIMP = (0.95, 0.99, 0.0005, 0.5, 2.0)
# s. Contact is as stiff as the time step allows: at 16 ms fingers end 1 mm deep in the object, at 20 ms 3 mm, and 6 mm
# in each other. Below the least one a closing takes minutes.
LEAST_TIMESTEP, LARGEST_TIMESTEP = 1e-5, 0.01
# Largest kinetic energy of a hand at rest over the servos' work. With more its contacts chatter, or it swings; a finger
# that slips off an edge has 0.2.
SETTLED = 0.01
NO_WORK = 1e-6  # J: smaller work counts as this, as where the hand starts at its targets

# By default the engine writes its warnings to a file in the working folder.
log = logging.getLogger(__name__)
mujoco.set_mju_user_warning(lambda message: log.debug("MuJoCo: %s", message))


class Closed(NamedTuple):
    """The end of one closing."""

    joint_positions: np.ndarray  # (J,)
    finite: bool  # False if the engine warned or gave NaN: not to be used
    settled: bool  # False if the hand isn't at rest


class GraspSimulation:
    """One object, as convex patches, and one hand whose palm can be put anywhere. Frame: the object's own. Omitted,
    because the result is the same: visual geometry, gravity (servos would carry the hand), the object's degrees of
    freedom (it is held), pairs of palm and object (neither moves, and they are apart) and of the object's patches. Not
    modelled, by choice: friction, with which fingers stick, and loose objects, which the first finger pushes away."""

    loose = False  # whether the object can move
    sides: np.ndarray  # of a grip: `palpate.grasp.hold`

    def __init__(
        self,
        hand: Hand,
        patches: list[np.ndarray],
        timestep: float = TIMESTEP,
        duration: float = DURATION,
        stiffness: float = STIFFNESS,
    ):
        """patches: of `surface_patches`, (V, 3) each, metres. timestep, duration: seconds. stiffness: the servos' gain,
        N m / rad. Raises ValueError for a time step at which closing isn't stable, or takes too long."""
        if not LEAST_TIMESTEP <= timestep <= LARGEST_TIMESTEP:
            raise ValueError(
                f"grasps: a time step of {1e3 * timestep:g} ms is not between {1e3 * LEAST_TIMESTEP:g} and"
                f" {1e3 * LARGEST_TIMESTEP:g} ms: fingers would sink into the object, or never get there"
            )
        self.hand, self.patches, self.timestep, self.stiffness = hand, patches, timestep, stiffness
        self.model = self.specification().compile()
        self.data = mujoco.MjData(self.model)
        self.steps = max(1, round(duration / timestep))
        # Of each step, how far the targets have moved from the open hand to their end.
        self.ramp = np.minimum(1.0, np.arange(1, self.steps + 1) / (RAMP * self.steps))
        self._palm = self.model.body(hand.link_names[0]).id
        self._object = self.model.body("object").id
        self._drivers = hand.drivers  # the joints that have a servo
        self._joints = slice(len(hand.joint_link))  # the hand's, in qpos

    def specification(self) -> mujoco.MjSpec:
        """Hand and object, with contacts as stiff as the time step allows."""
        spec = build_spec(self.hand, self.stiffness)
        spec.compiler.usethread = False  # its threads take an eighth more of the processor
        option = spec.option
        option.timestep = self.timestep
        option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        option.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
        option.iterations = ITERATIONS
        option.gravity = [0, 0, 0]
        body = spec.worldbody.add_body(name="object")
        for number, vertices in enumerate(self.patches):
            name = f"patch_{number}"
            mesh = spec.add_mesh(name=name, uservert=vertices.ravel())
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # a sheet has no volume
            body.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, condim=1)
        solref = [2 * self.timestep, 1]
        for constraint in (*spec.geoms, *spec.pairs, *spec.equalities):
            constraint.solref, constraint.solimp = solref, SOLIMP
        # As stiff as contact: by the engine's default a pushed finger leaves its range by 1.4 degrees.
        for joint in spec.joints:
            joint.solref_limit, joint.solimp_limit = solref, SOLIMP
        return spec

    def place(self, palm_pose: np.ndarray, joint_positions: np.ndarray) -> None:
        """Put the palm at `palm_pose` (4, 4) and the joints at `joint_positions` (J,), at rest."""
        mujoco.mj_resetData(self.model, self.data)
        self.model.body_pos[self._palm] = palm_pose[:3, 3]
        self.model.body_quat[self._palm] = quaternion(palm_pose[:3, :3])
        self.data.qpos[self._joints] = joint_positions
        self.data.ctrl[:] = joint_positions[self._drivers]
        mujoco.mj_forward(self.model, self.data)

    @property
    def joint_state(self) -> tuple[np.ndarray, np.ndarray]:
        """Joint positions (J,), rad (of a slide m), and velocities (J,), a second, in the present state."""
        return self.data.qpos[self._joints].copy(), self.data.qvel[self._joints].copy()

    @property
    def object_pose(self) -> np.ndarray:
        """Pose (4, 4) of the object in the present state: the identity, where it is held."""
        pose, rotation = np.eye(4), np.zeros(9)
        if self.loose:  # not `xpos`, which after a step is that before it
            mujoco.mju_quat2Mat(rotation, self.data.qpos[-4:])
            pose[:3, :3], pose[:3, 3] = rotation.reshape(3, 3), self.data.qpos[-7:-4]
        return pose

    def seen_from_object(self, pose: np.ndarray) -> np.ndarray:
        """A pose (4, 4) relative to the object in the present state, if it is that before the object has moved."""
        return np.linalg.inv(self.object_pose) @ pose if self.loose else pose

    def in_contact(self) -> bool:
        """Whether the hand touches the object in the present state; contact with itself does not count."""
        one, other = (self.model.geom_bodyid[self.data.contact.geom] == self._object).T
        return bool((one != other).any())

    def close(self, targets: np.ndarray) -> Closed:
        """Move the servos' targets from the present joint positions to `targets` (J,), then hold."""
        model, data = self.model, self.data
        work, before = 0.0, data.qvel.copy()
        for _ in self.closing(targets):
            work += data.qfrc_actuator @ (before + data.qvel) / 2 * model.opt.timestep
            before = data.qvel.copy()
        mujoco.mj_energyVel(model, data)
        # A NaN resets the state silently; only the warnings tell.
        finite = not any(warning.number for warning in data.warning) and bool(np.isfinite(data.qpos).all())
        settled = bool(data.energy[1] <= SETTLED * max(work, NO_WORK))
        return Closed(data.qpos[self._joints].copy(), finite, settled)

    def frames(self, targets: np.ndarray, steps: Collection[int]) -> Iterator[mujoco.MjData]:
        """The state after each of these numbers of steps of `close`, of which 0 is the present state; as `closing`."""
        states = itertools.chain([self.data], self.closing(targets))
        return (data for step, data in enumerate(states) if step in steps)

    def closing(self, targets: np.ndarray) -> Iterator[mujoco.MjData]:
        """The state after each step of `close`; it is the simulation's own and changes with the next step."""
        model, data = self.model, self.data
        start, targets = data.qpos[self._joints][self._drivers], targets[self._drivers]
        for step, share in enumerate(self.ramp):
            self.steer(step, start + share * (targets - start))
            mujoco.mj_step(model, data)
            yield data

    def steer(self, step: int, aim: np.ndarray) -> None:
        """Set the servos for a step of a closing; aim: their targets, on the way to where the closing ends."""
        self.data.ctrl[:] = aim
