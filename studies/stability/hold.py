"""Stability of the test whether a grasp holds: extreme friction, contact, weights, time steps, and thin blades."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import trimesh

from palpate.grasp.hold import DIRECTIONS, GRAVITY, HoldSimulation, body_of
from palpate.grasp.patches import surface_patches
from palpate.hand import from_mjcf
from palpate.hand.model import ARM, STIFFNESS
from palpate.mesh import load_collision
from studies.stability import shapes
from studies.stability.cases import Cases, Finding, at_least, at_most, equal
from studies.stability.closings import HAND, closing_setup

CASES = Cases()
GRIPPER = from_mjcf(*(Path(__file__).parents[2] / "config/hands" / name for name in ("wsg50.xml", "wsg50.yaml")))
HALF, GRIP, DISTANCE = 0.02, 1.0, 0.02  # m, half the width of a pinched box; N of each jaw; m that is not held
# Of the pinched box: friction, time step (s), time constant of contacts (time steps); its weight goes with friction.
EXTREMES = [(0.8, 0.004, 2), (0.8, 0.0005, 2), (0.8, 0.01, 2), (0.8, 0.004, 8), (0.05, 0.004, 2), (10, 0.004, 2)]


def pinched(load: float, friction: float, timestep: float, stiff: float) -> float:
    """How far a box moves across the jaws, m, whose weight is `load` times what their friction can carry."""
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
    ends = [(closing, each.joints) for closing, each in zip(setup.closings, setup.record(), strict=True)]
    for name, mesh, density in (("light", None, 0.1), ("heavy", None, 3e4), ("blade of 0.1 mm", blade, 1000.0)):
        mesh = load_collision(subject.folder) if mesh is None else mesh
        simulation = HoldSimulation(HAND, surface_patches(mesh), body_of(mesh, density), 0.8, 0.004)
        moved = np.array([
            [simulation.moved(pose, joints, targets, GRAVITY * axis, 1.0, DISTANCE) for axis in DIRECTIONS]
            for (pose, targets), joints in ends
        ])  # fmt: skip
        yield equal(f"{name}: directions that are not simulated", int(np.isnan(moved).sum()), 0)
        yield at_most(f"{name}: farthest", 1e3 * np.nanmax(moved), 3e3 * DISTANCE, "mm")
