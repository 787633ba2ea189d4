"""Stability of contact forces, and of the test whether a grasp holds: extreme gains, contact, friction, weights."""

from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
import trimesh

from palpate.grasp.closing import GraspSimulation
from palpate.grasp.contacts import OBJECT, contacts
from palpate.grasp.hold import DIRECTIONS, GRAVITY, HoldSimulation, body_of
from palpate.grasp.patches import surface_patches
from palpate.hand import from_mjcf
from palpate.hand.model import ARM, MAX_TORQUE, STIFFNESS
from palpate.mesh import load_collision
from studies.stability import shapes
from studies.stability.cases import Cases, Finding, at_least, at_most, equal
from studies.stability.closings import HAND, changed_copy, closing_setup
from studies.stability.contact import combined, gains, setting

CASES = Cases()
GRIPPER = from_mjcf(*(Path(__file__).parents[2] / "config/hands" / name for name in ("wsg50.xml", "wsg50.yaml")))
HALF, GRIP, DISTANCE = 0.02, 1.0, 0.02  # m, half the width of a pinched box; N of each jaw; m that is not held
# Of the pinched box: friction, time step (s), time constant of contacts (time steps); its weight goes with friction.
EXTREMES = [(0.8, 0.004, 2), (0.8, 0.0005, 2), (0.8, 0.01, 2), (0.8, 0.004, 8), (0.05, 0.004, 2), (10, 0.004, 2)]
WAY = 0.01  # m that jaws' targets are behind the surface
# Of forces: the servos' gain over the default's, and the contacts' time constant (time steps).
STIFF = [(0.1, 2), (1, 2), (10, 2), (1, 8), (1, 32)]
# s after a closing in which a hand comes to rest, and its largest speed then, rad / s. Contacts of 32 time steps are so
# soft that a finger may still slip through them after 1 s.
REST_WITHIN, AT_REST = 20.0, 1e-4


def pinched(load: float, friction: float, timestep: float, stiff: float) -> float:
    """The way of a box across the jaws, m, whose weight is `load` times what their friction can carry."""
    box = trimesh.creation.box((0.06, 0.03, 2 * HALF)).apply_translation((0.0406, 0, 0)).subdivide()
    body = body_of(box, load * 2 * friction * GRIP / GRAVITY / box.volume)
    simulation = HoldSimulation(GRIPPER, surface_patches(box), body, friction, timestep)
    simulation.model.geom_solref[:, 0] = stiff * timestep
    targets = np.full(2, HALF - GRIP * ARM**2 / STIFFNESS)
    return simulation.moved(np.eye(4), np.full(2, HALF), targets, np.array([GRAVITY, 0, 0]), 1.0, DISTANCE)


@CASES.case("a pinched box", "grasps")
def pinched_box(subject) -> Iterator[Finding]:
    """Two jaws carry twice friction times grip, and what they carry creeps by millimetres at most."""
    for friction, timestep, stiff in EXTREMES:
        what = f"friction {friction:g}, {1e3 * timestep:g} ms, {stiff:g} steps"
        yield at_most(f"{what}: moved at 0.9 of the load", 1e3 * pinched(0.9, friction, timestep, stiff), 5, "mm")
        yield at_least(f"{what}: moved at 1.1", 1e3 * pinched(1.1, friction, timestep, stiff), 1e3 * DISTANCE, "mm")


@CASES.case("light, heavy and thin objects", "grasps")
def objects(subject) -> Iterator[Finding]:
    """The engine simulates every direction; what is free falls, whatever it weighs."""
    setup, blade = closing_setup(subject), shapes.plate().apply_scale((1, 1, 0.01))  # 0.1 mm thick
    ends = [(closing, recorded.joints) for closing, recorded in zip(setup.closings, setup.record(), strict=True)]
    for name, mesh, density in (("light", None, 0.1), ("heavy", None, 3e4), ("blade of 0.1 mm", blade, 1000.0)):
        mesh = load_collision(subject.folder) if mesh is None else mesh
        simulation = HoldSimulation(HAND, surface_patches(mesh), body_of(mesh, density), 0.8, 0.004)
        moved = np.array([
            [simulation.moved(pose, joints, targets, GRAVITY * axis, 1.0, DISTANCE) for axis in DIRECTIONS]
            for (pose, targets), joints in ends
        ])  # fmt: skip
        yield equal(f"{name}: directions that are not simulated", int(np.isnan(moved).sum()), 0)
        yield at_most(f"{name}: farthest", 1e3 * np.nanmax(moved), 3e3 * DISTANCE, "mm")


def jaws_force(solid: trimesh.Trimesh, gain: float, steps: float) -> tuple[float, float]:
    """Mean over two jaws at rest at a solid: normal force, and the servo's force by its gain and place, N."""
    simulation = GraspSimulation(GRIPPER, surface_patches(solid), 0.004, 3.0, gain * STIFFNESS)
    simulation.model.geom_solref[:, 0] = steps * 0.004
    simulation.place(np.eye(4), GRIPPER.open_joint_positions)
    joints = simulation.close(np.full(2, HALF - WAY)).joint_positions
    servo = np.minimum(gain * STIFFNESS / ARM**2 * (joints - HALF + WAY), MAX_TORQUE / ARM)
    return contacts(simulation).force.sum() / 2, servo.mean()


@CASES.case("forces at rest", "grasps")
def forces(subject) -> Iterator[Finding]:
    """At a ball jaws press with gain times way; on slopes with the servo's force over the cosine. Fingers' contacts
    balance their servos: torques are J^T f, where no joint is at its limit."""
    ball, side = trimesh.creation.icosphere(3, HALF).apply_translation((0.0406, 0, 0)), 0.015
    setup = closing_setup(subject)
    for gain, steps in STIFF:
        what, rigid = f"gain x{gain:g}, {steps:g} steps", min(gain * STIFFNESS / ARM**2 * WAY, MAX_TORQUE / ARM)
        yield at_most(f"{what}: off at a ball", 100 * abs(jaws_force(ball, gain, steps)[0] / rigid - 1), 5, "%")
        for degrees in (20, 40):
            rise = side * np.tan(np.radians(degrees))
            ends = [
                (x, y, z)
                for x in (0.01, 0.07)
                for y, half in ((-side, HALF - rise), (side, HALF + rise))
                for z in (-half, half)
            ]
            force, servo = jaws_force(trimesh.convex.convex_hull(np.array(ends)), gain, steps)
            off = 100 * abs(force * np.cos(np.radians(degrees)) / servo - 1)
            yield at_most(f"{what}: off at {degrees} degrees", off, 0.1, "%")
        change = combined(gains(gain), setting(solref=(steps * 0.004, 1)))
        off = max(unbalanced(changed_copy(setup.grasper.simulation, change), *closing) for closing in setup.closings)
        yield at_most(f"{what}: torques off J^T f", 100 * off, 5, "%")


def unbalanced(simulation: GraspSimulation, pose: np.ndarray, targets: np.ndarray) -> float:
    """Largest torque at rest that contacts do not balance, over the servos' largest."""
    model, data = simulation.model, simulation.data
    simulation.place(pose, HAND.open_joint_positions)
    simulation.close(targets)
    for _ in range(round(REST_WITHIN / model.opt.timestep)):
        if np.abs(data.qvel).max() < AT_REST:
            break
        mujoco.mj_step(model, data)
    joints = simulation.joint_state[0]
    mujoco.mj_forward(model, data)
    torques, jacobian = data.qfrc_actuator.copy(), np.zeros((3, model.nv))
    largest = np.abs(torques).max()
    for place, normal, force, *pair, _ in zip(*contacts(simulation), strict=True):
        for link, sign in zip(pair, (1, -1), strict=True):
            if link != OBJECT:
                mujoco.mj_jac(model, data, jacobian, None, place, model.body(HAND.link_names[link]).id)
                torques += sign * force * normal @ jacobian
    low, high = HAND.joint_range.T + [[0.002], [-0.002]]
    inside = (low < joints) & (joints < high)
    return float(np.abs(torques[inside]).max() / largest)
