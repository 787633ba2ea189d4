"""Closings watched step by step: what the servos put in, what moves, how deep fingers are."""

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
from studies.stability.cases import Finding, at_most, equal
from studies.subjects import Subject

HAND = allegro()
CLOSINGS = 3
POINTS = 4000
HOLD = 1.0  # s after a closing in which even a creeping finger comes to rest: 18 of the servos' time constants
TOUCHED = "closed"  # what becomes of a closing that the grasper takes
NEAREST_BASE = 0.14  # m from the base of an Allegro's finger to its gel
JOINT = MAX_PENETRATION / NEAREST_BASE  # rad, by which a finger's tip moves by what it may be deep: 0.4 degrees
GEL = 0.0032 / NEAREST_BASE  # rad, by which it moves by its gel's thickness: 1.3 degrees


class Closing(NamedTuple):
    """A palm pose (4, 4), clear of the object, and the servos' targets (J,)."""

    pose: np.ndarray
    targets: np.ndarray


class Watched(NamedTuple):
    """One closing. kinetic, work: (S,) J after each step; work: what servos put in, not what they took."""

    label: str
    joints: np.ndarray  # (J,)
    warnings: int
    kinetic: np.ndarray
    work: np.ndarray
    path: np.ndarray  # (S, J) joints after each step
    depth: float  # m at the end, of the hand in the object or in itself, by their true surfaces
    outcome: str  # `TOUCHED`, or the grasper's reason

    @property
    def gain(self) -> float:
        """Kinetic energy as a share of the servos' work until then, at worst: over 1 it came from nowhere."""
        moving = self.kinetic > 0
        return float((self.kinetic[moving] / np.maximum(self.work[moving], 1e-12)).max(initial=0))


class Setting(NamedTuple):
    """An object of the run, its grasper, and the closings that all cases look at."""

    grasper: Grasper
    closings: list[Closing]

    def watch(
        self,
        change: Callable[[GraspSimulation], None] | None = None,
        label: str = "",
        simulation: GraspSimulation | None = None,
    ) -> list[Watched]:
        """All closings, in a copy of the simulation (or of `simulation`) that `change` has had."""
        simulation = variant(simulation or self.grasper.simulation, change)
        return [watch(self.grasper, simulation, each, label) for each in self.closings]


@lru_cache(maxsize=1)
def setting(subject: Subject) -> Setting:
    """Grasper and closings of an object; the palm poses are random, the same every time."""
    visual, collision = load_visual(subject.folder), load_collision(subject.folder)
    points = trimesh.sample.sample_surface(visual, POINTS, seed=0)[0]
    grasper = Grasper(visual, collision, points, HAND)
    rng, closings = np.random.default_rng(0), []
    for _ in range(CLOSINGS):
        pose = grasper.free_palm_pose(rng)
        if pose is None:
            raise ValueError(f"{subject.name}: {CLOSINGS} palm poses free of the object were not found")
        closings.append(Closing(pose, grasper.workspace.targets(pose, grasper.surface)))
    return Setting(grasper, closings)


class Recorded(GraspSimulation):
    """A simulation that keeps kinetic energy (J) and joints after each step, and what servos put in by it (J)."""

    def __init__(self, simulation: GraspSimulation):
        vars(self).update(vars(simulation))
        self.kinetic, self.work, self.path = [], [], []

    def closing(self, targets: np.ndarray) -> Iterator[mujoco.MjData]:
        before = self.data.qvel.copy()
        for data in super().closing(targets):
            power = data.qfrc_actuator * (before + data.qvel) / 2
            self.work.append(np.maximum(power, 0).sum() * self.model.opt.timestep)
            before = data.qvel.copy()
            mujoco.mj_energyVel(self.model, data)
            self.kinetic.append(data.energy[1])
            self.path.append(data.qpos.copy())
            yield data


def variant(simulation: GraspSimulation, change: Callable[[GraspSimulation], None] | None = None) -> GraspSimulation:
    """A copy of a simulation with a model of its own, which `change` may edit."""
    simulation = copy.copy(simulation)
    simulation.model = copy.deepcopy(simulation.model)
    if change is not None:
        change(simulation)
    simulation.data = mujoco.MjData(simulation.model)
    return simulation


def held(simulation: GraspSimulation) -> None:
    """Let a simulation hold the targets for `HOLD` more."""
    more = round(HOLD / simulation.model.opt.timestep)
    simulation.ramp = np.concatenate([simulation.ramp, np.ones(more)])
    simulation.steps += more


def watch(
    grasper: Grasper, simulation: GraspSimulation, closing: Closing, label: str = "", start: np.ndarray | None = None
) -> Watched:
    """What the grasper makes of a closing in `simulation`, from joint positions (J,) `start` (default: open)."""
    hand = simulation.hand
    seen, judge = Recorded(simulation), copy.copy(grasper)
    judge.simulation = seen
    seen.place(closing.pose, hand.open_joint_positions if start is None else start)
    result = judge.closed_at(closing.pose, closing.targets)
    joints = seen.data.qpos.copy()
    if isinstance(result, Grasp):
        outcome, depth = TOUCHED, result.penetration
    else:
        links = hand.forward(closing.pose, joints)
        outcome, depth = result, max(grasper.check.in_object(links), grasper.check.in_itself(links))
    warnings = int(sum(warning.number for warning in seen.data.warning))
    return Watched(
        label,
        joints,
        warnings,
        np.array(seen.kinetic),
        np.cumsum(seen.work),
        np.array(seen.path),
        depth,
        outcome,
    )


def deepest(grasper: Grasper, closing: Closing, watched: Watched, every: int = 3) -> float:
    """Depth in the object at any time of a closing, looked at after every so many steps: metres."""
    links = grasper.hand.forward(closing.pose, watched.path[::every])
    return max(map(grasper.check.in_object, links))


def sound(watched: Iterable[Watched], depth: float = MAX_PENETRATION, what: str = "") -> Iterator[Finding]:
    """Findings of closings that should go as the mild ones do: the worst of each quantity.

    The engine warns of nothing; from rest and without gravity kinetic energy comes from the servos alone, for
    contacts and dampers only take; no surface is deeper than allowed.
    """
    watched, what = list(watched), f"{what}: " if what else ""
    warned = {each.label for each in watched if each.warnings}
    yield equal(f"{what}engine's warnings", sum(each.warnings for each in watched), 0, note=", ".join(warned))
    worst = max(watched, key=lambda each: each.gain)
    yield at_most(f"{what}kinetic energy over the servos' work", worst.gain, 1, note=worst.label)
    worst = max(watched, key=lambda each: each.depth)
    yield at_most(f"{what}depth by true surfaces", 1e3 * worst.depth, 1e3 * depth, "mm", worst.label)


def agree(
    watched: Iterable[Watched], mild: Iterable[Watched], bound: float = JOINT, what: str = "joints' change"
) -> Finding:
    """That joints end where the mild case's do, in the median closing, for a finger may slip off an edge."""
    changes = [change(one, other) for one, other in zip(watched, mild, strict=True)]
    return at_most(what, float(np.median(changes)), bound, "rad", f"median of closings; worst {max(changes):.2g}")


def change(one: Watched, other: Watched) -> float:
    """The largest difference of the joints at the end, rad."""
    return float(np.abs(one.joints - other.joints).max())
