"""Omissions of the grasp simulation: items it omits, items it has, and items it does not model by choice."""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh

from palpate.batch import generator
from palpate.grasp.closing import GraspSimulation
from palpate.grasp.patches import surface_patches
from palpate.grasp.penetration import PenetrationCheck
from palpate.hand import Hand
from palpate.mesh import load_collision, load_visual
from studies.grasping import Closing, find_closings, grasper_of
from studies.omitted.omission import NOT_MODELLED, OMITTED, STAYS, Omission
from studies.omitted.simulations import ChangedSimulation, EveryFace, EveryPair, ReachLimitedSimulation
from studies.subjects import Subject

CLOSINGS = 4  # an object
CHECKED = 2  # of them, on whose targets the penetration check runs
# Degrees. Gravity and its compensation change rounding; an object held by forces moves by less than 1e-7 m. The error
# of the default time step is 0.1 degrees.
ROUNDING, GIVING_WAY = 1e-6, 0.01
BOUNDS = {"gravity": ROUNDING, "object degrees of freedom": GIVING_WAY}

# Items that enlarge the compiled model: their times include its compilation.
IN_THE_MODEL = ("visual geometry", "pairs of palm and object", "pairs of object patches")
# Items that the engine omits: the result is the same.
OMITTED_ITEMS = (IN_THE_MODEL[0], "gravity", "object degrees of freedom", *IN_THE_MODEL[1:])
# Items that the penetration check omits, each with a check that doesn't, and the method to compare.
CHECK_ITEMS: dict[str, tuple[type[PenetrationCheck], str]] = {
    "faces out of the hand": (EveryFace, "in_object"),
    "links apart": (EveryPair, "in_itself"),
}
# Items that the engine does not model by choice, and why: with them the result is different.
NOT_MODELLED_ITEMS = {
    "pairs of joined links": "their boxes overlap at the hinge, where the links themselves don't",
    "friction": "fingers slide to where their servos want them; with it they stick where they touch first",
    "sag under gravity": "servos without compensation end below their targets",
    "loose object": "the first finger would push it away, and its pose would not be known",
}
# Items that the engine has, and why.
KEPT_ITEMS = {
    "self-collision": "fingers would pass through each other",
    "patches out of reach": "the engine's tree of boxes passes them by: nothing would be saved",
}
ITEMS = (*OMITTED_ITEMS, *CHECK_ITEMS, *NOT_MODELLED_ITEMS, *KEPT_ITEMS)
# Tens of thousands of pairs, half a second a closing and more: one closing on one object only.
SLOW = "pairs of object patches"


class Case(NamedTuple):
    """One object with closings, in its frame."""

    name: str
    visual: trimesh.Trimesh
    patches: list[np.ndarray]
    hand: Hand
    timestep: float  # s
    closings: list[Closing]


class FinalJoints(NamedTuple):
    """Joint positions (closings, J) in radians, and the size of the compiled model."""

    joint_positions: np.ndarray
    model_bytes: int


def omissions(run: Path, subjects: list[Subject], settings: Mapping) -> Iterator[Omission]:
    """Closings with and without each item, and the penetration check with and without its items.

    The pairs of patches are measured on the object with the fewest, in one closing.
    """
    cases = [load_case(run, subject, settings["grasps"]["timestep"]) for subject in subjects]
    cases = [case for case in cases if case.closings]
    for case in cases:
        for item in (*OMITTED_ITEMS, *NOT_MODELLED_ITEMS, *KEPT_ITEMS):
            if item != SLOW:
                yield closing_omission(case, item)
        yield from check_omissions(case)
    fewest = min(cases, key=lambda case: len(case.patches))
    yield closing_omission(fewest._replace(closings=fewest.closings[:1]), SLOW)


def load_case(run: Path, subject: Subject, timestep: float) -> Case:
    """An object of the run with `CLOSINGS` closings, drawn as in the stage."""
    grasper = grasper_of(run, subject, timestep=timestep)
    closings = find_closings(grasper, generator(0, subject.name, "left out"), CLOSINGS)
    patches = surface_patches(load_collision(subject.folder))
    return Case(subject.name, load_visual(subject.folder), patches, grasper.hand, timestep, closings)


def closing_omission(case: Case, item: str) -> Omission:
    """The omission of an item of the simulation."""
    engine = partial(GraspSimulation, case.hand, case.patches, case.timestep)
    compiled = [partial(changed_simulation, case, item), engine]
    if item in KEPT_ITEMS:
        compiled.reverse()
    if item in IN_THE_MODEL:
        runs = [lambda make=make: final_joints(make(), case) for make in compiled]
    else:
        runs = [partial(final_joints, make(), case) for make in compiled]
    state = NOT_MODELLED if item in NOT_MODELLED_ITEMS else STAYS if item in KEPT_ITEMS else OMITTED
    how = {"bound": BOUNDS.get(item, 0.0), "size": lambda joints: joints.model_bytes, "state": state}
    return Omission("grasp", item, when(item), case.name, *runs, joint_difference, "degrees", **how)


def changed_simulation(case: Case, *items: str) -> GraspSimulation:
    """The simulation with items that the engine lacks, or without items that it has."""
    if items == ("patches out of reach",):
        return ReachLimitedSimulation(case.hand, case.patches, case.timestep)
    return ChangedSimulation(case.hand, case.patches, case.timestep, items, case.visual)


def when(item: str) -> str:
    """When an item is omitted, as text."""
    if item in NOT_MODELLED_ITEMS:
        return f"always, by choice of the model, not as a saving: {NOT_MODELLED_ITEMS[item]}"
    return f"never: {KEPT_ITEMS[item]}" if item in KEPT_ITEMS else "always"


def final_joints(simulation: GraspSimulation, case: Case) -> FinalJoints:
    """Run all closings of a case."""
    joints = []
    for pose, targets in case.closings:
        simulation.place(pose, case.hand.open_joint_positions)
        joints.append(simulation.close(targets).joint_positions)
    return FinalJoints(np.array(joints), simulation.model.nbuffer)


def joint_difference(one: FinalJoints, other: FinalJoints) -> float:
    """Largest difference of final joint positions, degrees."""
    return float(np.degrees(np.abs(one.joint_positions - other.joint_positions).max()))


def check_omissions(case: Case) -> Iterator[Omission]:
    """Omissions of the penetration check, on hands at their targets, deeper than grasps ever are."""
    links = [case.hand.forward(*closing) for closing in case.closings[:CHECKED]]

    def depths(depth_of: Callable[[np.ndarray], float]) -> np.ndarray:
        return np.array([depth_of(each) for each in links])

    def largest_difference(one: np.ndarray, other: np.ndarray) -> float:
        return float(np.abs(one - other).max())

    for item, (naive, method) in CHECK_ITEMS.items():
        of = (getattr(check(case.hand, case.visual), method) for check in (naive, PenetrationCheck))
        checks = [partial(depths, each) for each in of]
        yield Omission("grasp", item, when(item), case.name, *checks, largest_difference, "m")
