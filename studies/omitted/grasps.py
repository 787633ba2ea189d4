"""Omissions of the grasp simulation: items it omits, items it has, and items it does not model by choice."""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh

from palpate import store
from palpate.batch import generator
from palpate.grasp.closing import GraspSimulation
from palpate.grasp.grasp import Grasper
from palpate.grasp.patches import surface_patches
from palpate.grasp.penetration import PenetrationCheck
from palpate.hand import Hand
from palpate.mesh import OBJECT_POSITION, load_collision, load_visual
from studies.omitted.omission import NOT_MODELLED, OMITTED, STAYS, Omission
from studies.omitted.reach import ReachLimitedSimulation
from studies.omitted.simulations import ChangedSimulation, EveryFace, EveryPair
from studies.scenes import hand_of
from studies.subjects import Subject

CLOSINGS = 4  # an object
CHECKED = 2  # of them, on whose targets the penetration check runs
# Degrees. Gravity and its compensation change rounding; an object held by forces moves by less than 1e-7 m. The error
# of the default time step is 0.1 degrees.
ROUNDING, GIVING_WAY = 1e-6, 0.01
BOUNDS = {"gravity": ROUNDING, "object degrees of freedom": GIVING_WAY}

# Items that the engine omits: the result is the same.
OMITTED_ITEMS = (
    "visual geometry",
    "gravity",
    "object degrees of freedom",
    "pairs of palm and object",
    "pairs of object patches",
)
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
# Items that enlarge the compiled model: their times include its compilation.
IN_THE_MODEL = ("visual geometry", "pairs of palm and object", "pairs of object patches")
# Tens of thousands of pairs, half a second a closing and more: one closing on one object only.
SLOW = "pairs of object patches"


class Case(NamedTuple):
    """One object with closings: collision-free palm poses (4, 4) in the object's frame, and targets (J,)."""

    name: str
    visual: trimesh.Trimesh
    patches: list[np.ndarray]
    hand: Hand
    timestep: float  # s
    closings: list[tuple[np.ndarray, np.ndarray]]


class FinalJoints(NamedTuple):
    """Joint positions (closings, J) in radians, and the size of the compiled model."""

    joint_positions: np.ndarray
    model_bytes: int


def omissions(run: Path, subjects: list[Subject], settings: Mapping) -> Iterator[Omission]:
    """Closings with and without each item, and the penetration check with and without its items.

    The pairs of patches are measured on the object with the fewest, in one closing. settings: `grasps`. Reads the
    run's meshes, surface and grasps (for the hand).
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
    visual, collision = load_visual(subject.folder), load_collision(subject.folder)
    surface = store.read(run / f"surface/{subject.batch}.zarr", "object", "points")
    points = surface["points"][list(surface["object"]).index(subject.name)] - np.array(OBJECT_POSITION)
    hand = hand_of(run, subject.batch)
    grasper = Grasper(visual, collision, points, hand, timestep)
    rng, closings = generator(0, subject.name, "left out"), []
    for _ in range(CLOSINGS):
        pose = grasper.free_palm_pose(rng)
        if pose is not None:
            closings.append((pose, grasper.workspace.targets(pose, grasper.surface)))
    return Case(subject.name, visual, surface_patches(collision), hand, timestep, closings)


def closing_omission(case: Case, item: str) -> Omission:
    """The omission of an item of the simulation."""
    simulations = [
        partial(changed_simulation, case, item),
        partial(GraspSimulation, case.hand, case.patches, case.timestep),
    ]
    if item in KEPT_ITEMS:
        simulations.reverse()
    if item in IN_THE_MODEL:
        with_it, without = (lambda compiled=compiled: final_joints(compiled(), case) for compiled in simulations)
    else:
        with_it, without = (partial(final_joints, compiled(), case) for compiled in simulations)
    return Omission(
        stage="grasp",
        item=item,
        when=when(item),
        object=case.name,
        with_it=with_it,
        without=without,
        difference=joint_difference,
        unit="degrees",
        bound=BOUNDS.get(item, 0.0),
        size=lambda joints: joints.model_bytes,
        state=NOT_MODELLED if item in NOT_MODELLED_ITEMS else STAYS if item in KEPT_ITEMS else OMITTED,
    )


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
    links = [case.hand.forward(pose, targets) for pose, targets in case.closings[:CHECKED]]
    for item, (naive, depth_of) in CHECK_ITEMS.items():
        with_it, without = (getattr(check(case.hand, case.visual), depth_of) for check in (naive, PenetrationCheck))
        yield Omission(
            stage="grasp",
            item=item,
            when=when(item),
            object=case.name,
            with_it=partial(penetration_depths, with_it, links),
            without=partial(penetration_depths, without, links),
            difference=lambda one, other: float(np.abs(one - other).max()),
            unit="m",
        )


def penetration_depths(depth_of: Callable[[np.ndarray], float], links: list[np.ndarray]) -> np.ndarray:
    """Penetration of each hand (n,), metres."""
    return np.array([depth_of(each) for each in links])
