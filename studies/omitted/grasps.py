"""Omissions of the grasp simulation: items it omits, items it has, and items it does not model by choice."""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh
import yaml

from palpate.batch import generator
from palpate.grasp.closing import GraspSimulation
from palpate.grasp.patches import surface_patches
from palpate.grasp.penetration import PenetrationCheck
from palpate.hand import Hand
from palpate.mesh import load_collision, load_visual
from studies.grasping import Closing, find_closings, grasper_of
from studies.omitted.omission import STAYS, Omission
from studies.omitted.simulations import ChangedSimulation, EveryFace, EveryPair
from studies.subjects import Subject

CLOSINGS = 4  # an object
CHECKED = 2  # of them, on whose targets the penetration check runs
_DECLARED = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text())
ITEMS, CHECK_ITEMS = _DECLARED["simulation"], _DECLARED["check"]


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
        for item, row in ITEMS.items():
            if not row.get("slow"):
                yield closing_omission(case, item)
        yield from check_omissions(case)
    fewest = min(cases, key=lambda case: len(case.patches))
    for item in (item for item, row in ITEMS.items() if row.get("slow")):
        yield closing_omission(fewest._replace(closings=fewest.closings[:1]), item)


def load_case(run: Path, subject: Subject, timestep: float) -> Case:
    """An object of the run with `CLOSINGS` closings, drawn as in the stage."""
    grasper = grasper_of(run, subject, timestep=timestep)
    closings = find_closings(grasper, generator(0, subject.name, "left out"), CLOSINGS)
    patches = surface_patches(load_collision(subject.folder))
    return Case(subject.name, load_visual(subject.folder), patches, grasper.hand, timestep, closings)


def closing_omission(case: Case, item: str) -> Omission:
    """The omission of an item of the simulation."""
    row, engine = ITEMS[item], partial(GraspSimulation, case.hand, case.patches, case.timestep)
    compiled = [partial(changed_simulation, case, item), engine]
    if row["state"] == STAYS:
        compiled.reverse()
    if row.get("compiled"):
        runs = [lambda make=make: final_joints(make(), case) for make in compiled]
    else:
        runs = [partial(final_joints, make(), case) for make in compiled]
    how = {"bound": row.get("bound", 0.0), "size": lambda joints: joints.model_bytes, "state": row["state"]}
    return Omission("grasp", item, row["when"], case.name, *runs, joint_difference, "degrees", **how)


def changed_simulation(case: Case, *items: str) -> GraspSimulation:
    """The simulation with items that the engine lacks, or without items that it has."""
    return ChangedSimulation(case.hand, case.patches, case.timestep, items, case.visual)


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
        return np.array([depth_of(pose) for pose in links])

    def largest_difference(one: np.ndarray, other: np.ndarray) -> float:
        return float(np.abs(one - other).max())

    naive = type("Naive", (EveryFace, EveryPair), {})
    for item, method in CHECK_ITEMS.items():
        runs = [partial(depths, getattr(check(case.hand, case.visual), method)) for check in (naive, PenetrationCheck)]
        yield Omission("grasp", item, "always", case.name, *runs, largest_difference, "m")
