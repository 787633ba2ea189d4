"""Closings recorded at each time step: servo work, kinetic energy, and final joints and penetration."""

import copy
from collections.abc import Callable, Iterable, Iterator
from functools import lru_cache
from typing import NamedTuple

import mujoco
import numpy as np
import trimesh

from palpate.grasp.closing import GraspSimulation
from palpate.grasp.grasp import Grasp, Grasper
from palpate.hand import MAX_PENETRATION, allegro
from palpate.mesh import load_collision, load_visual
from studies.grasping import Closing, find_closings
from studies.stability.cases import Finding, at_most, equal
from studies.subjects import Subject

HAND = allegro()
CLOSINGS = 3
POINTS = 4000
HOLD_DURATION = 1.0  # s after a closing: 18 time constants of the servos, so that slow fingers come to rest, too
CLOSED = "closed"  # outcome of a closing that the grasper accepts
FINGER_LENGTH = 0.14  # m from the base of an Allegro's finger to its gel
JOINT_TOLERANCE = MAX_PENETRATION / FINGER_LENGTH  # rad: moves a fingertip by the allowed penetration; 0.4 degrees
GEL_TOLERANCE = 0.0032 / FINGER_LENGTH  # rad: moves a fingertip by its gel's thickness; 1.3 degrees


class RecordedClosing(NamedTuple):
    """One closing. kinetic, work: (S,) J after each step; work is the positive work of the servos alone."""

    label: str
    joints: np.ndarray  # (J,)
    warnings: int
    kinetic: np.ndarray
    work: np.ndarray
    depth: float  # m at the end, of the hand in the object or in itself, by their true surfaces
    outcome: str  # `CLOSED`, or the grasper's reason

    @property
    def energy_gain(self) -> float:
        """Largest ratio of kinetic energy to the servos' work so far; above 1 the simulation has created energy."""
        moving = self.kinetic > 0
        return float((self.kinetic[moving] / np.maximum(self.work[moving], 1e-12)).max(initial=0))


class ClosingSetup(NamedTuple):
    """An object of the run, its grasper, and the closings that all cases use."""

    grasper: Grasper
    closings: list[Closing]

    def record(
        self,
        change: Callable | None = None,
        label: str = "",
        simulation: GraspSimulation | None = None,
    ) -> list[RecordedClosing]:
        """Record all closings in a copy of the simulation (or of `simulation`), edited by `change`."""
        simulation = changed_copy(simulation or self.grasper.simulation, change)
        return [record(self.grasper, simulation, closing, label) for closing in self.closings]


@lru_cache(maxsize=1)
def closing_setup(subject: Subject) -> ClosingSetup:
    """Grasper and closings of an object; the palm poses are random with a fixed seed."""
    visual, collision = load_visual(subject.folder), load_collision(subject.folder)
    points = trimesh.sample.sample_surface(visual, POINTS, seed=0)[0]
    grasper = Grasper(visual, collision, points, HAND)
    closings = find_closings(grasper, np.random.default_rng(0), CLOSINGS)
    if len(closings) < CLOSINGS:
        raise ValueError(f"{subject.name}: {CLOSINGS} palm poses free of the object were not found")
    return ClosingSetup(grasper, closings)


class RecordingSimulation(GraspSimulation):
    """A simulation that records kinetic energy (J) and the servos' positive work (J) of each step."""

    def __init__(self, simulation: GraspSimulation):
        vars(self).update(vars(simulation))
        self.kinetic, self.work = [], []

    def closing(self, targets: np.ndarray) -> Iterator[mujoco.MjData]:
        """As `GraspSimulation.closing`, with kinetic energy and the servos' work recorded after each step."""
        before = self.data.qvel.copy()
        for data in super().closing(targets):
            power = data.qfrc_actuator * (before + data.qvel) / 2
            self.work.append(np.maximum(power, 0).sum() * self.model.opt.timestep)
            before = data.qvel.copy()
            mujoco.mj_energyVel(self.model, data)
            self.kinetic.append(data.energy[1])
            yield data


def changed_copy(
    simulation: GraspSimulation, change: Callable[[GraspSimulation], None] | None = None
) -> GraspSimulation:
    """Copy a simulation and its model; `change` may edit the copy."""
    simulation = copy.copy(simulation)
    simulation.model = copy.deepcopy(simulation.model)
    if change is not None:
        change(simulation)
    simulation.data = mujoco.MjData(simulation.model)
    return simulation


def hold_targets(simulation: GraspSimulation) -> None:
    """Extend a simulation: hold the targets for another `HOLD_DURATION`."""
    extra = round(HOLD_DURATION / simulation.model.opt.timestep)
    simulation.ramp = np.concatenate([simulation.ramp, np.ones(extra)])
    simulation.steps += extra


def record(grasper: Grasper, simulation: GraspSimulation, closing: Closing, label: str = "") -> RecordedClosing:
    """Close the hand in `simulation`, judged by the grasper."""
    hand = simulation.hand
    seen, judge = RecordingSimulation(simulation), copy.copy(grasper)
    judge.simulation = seen
    seen.place(closing.pose, hand.open_joint_positions)
    result = judge.closed_at(closing.pose, closing.targets)
    joints = seen.data.qpos.copy()
    if isinstance(result, Grasp):
        outcome, depth = CLOSED, result.penetration
    else:
        links = hand.forward(closing.pose, joints)
        outcome, depth = result, max(grasper.check.in_object(links), grasper.check.in_itself(links))
    warnings = int(sum(warning.number for warning in seen.data.warning))
    return RecordedClosing(label, joints, warnings, np.array(seen.kinetic), np.cumsum(seen.work), depth, outcome)


def soundness(recorded: Iterable[RecordedClosing], what: str = "") -> Iterator[Finding]:
    """Findings of physically sound closings: the worst of each quantity.

    The engine gives no warning. Kinetic energy stays below the servos' work: the hand starts at rest, there is
    no gravity, and contacts and dampers only dissipate. No surface penetrates deeper than `MAX_PENETRATION`.
    """
    recorded, what = list(recorded), f"{what}: " if what else ""
    warned = {closing.label for closing in recorded if closing.warnings}
    yield equal(f"{what}engine's warnings", sum(closing.warnings for closing in recorded), 0, note=", ".join(warned))
    worst = max(recorded, key=lambda closing: closing.energy_gain)
    yield at_most(f"{what}kinetic energy over the servos' work", worst.energy_gain, 1, note=worst.label)
    worst = max(recorded, key=lambda closing: closing.depth)
    yield at_most(f"{what}depth by true surfaces", 1e3 * worst.depth, 1e3 * MAX_PENETRATION, "mm", worst.label)


def joints_agree(
    recorded: Iterable[RecordedClosing],
    mild: Iterable[RecordedClosing],
    bound: float = JOINT_TOLERANCE,
    what: str = "joints' change",
) -> Finding:
    """Finding: joints end where those of the mild case do, in the median closing (a finger may slip off an edge)."""
    changes = [joint_change(one, other) for one, other in zip(recorded, mild, strict=True)]
    return at_most(what, float(np.median(changes)), bound, "rad", f"median of closings; worst {max(changes):.2g}")


def joint_change(one: RecordedClosing, other: RecordedClosing) -> float:
    """Largest difference of the final joint positions, rad."""
    return float(np.abs(one.joints - other.joints).max())
