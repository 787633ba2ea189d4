"""What the simulation of a grasp omits, what it keeps, and what it does not model by choice."""

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
from studies.omitted.reach import WithinReach
from studies.omitted.simulations import ChangedSimulation, EveryFace, EveryPair
from studies.subjects import Subject

CLOSINGS = 4  # an object
CHECKED = 2  # of them, whose ends the check of penetration looks at
# Degrees. Gravity, and what carries it, rounds anew; an object held by forces gives way by less than 1e-7 m.
# The error of the default time step is 0.1 degrees.
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
# Items that the check of penetration omits, each with a check that doesn't, and the method that looks.
CHECK_ITEMS: dict[str, tuple[type[PenetrationCheck], str]] = {
    "faces out of the hand": (EveryFace, "in_object"),
    "links apart": (EveryPair, "in_itself"),
}
# Items that the engine goes without by choice, and why: with them the result is another.
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
# Items that the compiled model grows by: they are timed with its compilation.
IN_THE_MODEL = ("visual geometry", "pairs of palm and object", "pairs of object patches")
# Tens of thousands of pairs, at half a second a closing and more: tried on one object, once.
SLOW = "pairs of object patches"


class Case(NamedTuple):
    """One object, and closings on it: palm poses (4, 4) clear of it, in its own frame, and targets (J,)."""

    name: str
    visual: trimesh.Trimesh
    patches: list[np.ndarray]
    hand: Hand
    timestep: float  # s
    closings: list[tuple[np.ndarray, np.ndarray]]


class Ends(NamedTuple):
    """Joint positions (closings, J) in radians, and the size of the compiled model."""

    joint_positions: np.ndarray
    model_bytes: int


def omissions(run: Path, subjects: list[Subject], settings: Mapping) -> Iterator[Omission]:
    """The same closings with each item and without it, and the check of where they end.

    The pairs of patches are tried on the object that has the fewest, with one closing.
    settings: `grasps`. Read of the run: meshes, surface and grasps (for the hand).
    """
    cases = [case_of(run, subject, settings["grasps"]["timestep"]) for subject in subjects]
    cases = [case for case in cases if case.closings]
    for case in cases:
        for item in (*OMITTED_ITEMS, *NOT_MODELLED_ITEMS, *KEPT_ITEMS):
            if item != SLOW:
                yield of_closings(case, item)
        yield from of_check(case)
    fewest = min(cases, key=lambda case: len(case.patches))
    yield of_closings(fewest._replace(closings=fewest.closings[:1]), SLOW)


def case_of(run: Path, subject: Subject, timestep: float) -> Case:
    """An object of the run with `CLOSINGS` closings, drawn as the stage draws them."""
    visual, collision = load_visual(subject.folder), load_collision(subject.folder)
    surface = store.read(run / f"surface/{subject.batch}.zarr", "object", "points")
    points = surface["points"][list(surface["object"]).index(subject.name)] - np.array(OBJECT_POSITION)
    grasps = store.open(run / f"grasps/{subject.batch}.h5")
    hand = Hand.from_arrays(grasps, prefix="hand/")
    grasper = Grasper(visual, collision, points, hand, timestep)
    rng, closings = generator(0, subject.name, "left out"), []
    for _ in range(CLOSINGS):
        pose = grasper.free_palm_pose(rng)
        if pose is not None:
            closings.append((pose, grasper.workspace.targets(pose, grasper.surface)))
    return Case(subject.name, visual, surface_patches(collision), hand, timestep, closings)


def of_closings(case: Case, item: str) -> Omission:
    """An item of the simulation."""
    simulations = [partial(changed, case, item), partial(GraspSimulation, case.hand, case.patches, case.timestep)]
    if item in KEPT_ITEMS:
        simulations.reverse()
    if item in IN_THE_MODEL:
        with_it, without = (lambda compiled=compiled: ends(compiled(), case) for compiled in simulations)
    else:
        with_it, without = (partial(ends, compiled(), case) for compiled in simulations)
    return Omission(
        stage="grasp",
        item=item,
        when=when(item),
        object=case.name,
        with_it=with_it,
        without=without,
        difference=turned,
        unit="degrees",
        bound=BOUNDS.get(item, 0.0),
        size=lambda found: found.model_bytes,
        state=NOT_MODELLED if item in NOT_MODELLED_ITEMS else STAYS if item in KEPT_ITEMS else OMITTED,
    )


def changed(case: Case, *items: str) -> GraspSimulation:
    """The simulation with the items that the engine lacks, or without those that it has."""
    if items == ("patches out of reach",):
        return WithinReach(case.hand, case.patches, case.timestep)
    return ChangedSimulation(case.hand, case.patches, case.timestep, items, case.visual)


def when(item: str) -> str:
    """When an item is omitted, in words."""
    if item in NOT_MODELLED_ITEMS:
        return f"always, by choice of the model, not as a saving: {NOT_MODELLED_ITEMS[item]}"
    return f"never: {KEPT_ITEMS[item]}" if item in KEPT_ITEMS else "always"


def ends(simulation: GraspSimulation, case: Case) -> Ends:
    """Where the joints end, in each closing."""
    found = []
    for pose, targets in case.closings:
        simulation.place(pose, case.hand.open_joint_positions)
        found.append(simulation.close(targets).joint_positions)
    return Ends(np.array(found), simulation.model.nbuffer)


def turned(one: Ends, other: Ends) -> float:
    """Degrees by which any joint ends elsewhere."""
    return float(np.degrees(np.abs(one.joint_positions - other.joint_positions).max()))


def of_check(case: Case) -> Iterator[Omission]:
    """Items of the check of penetration, on hands at their targets: deeper than they come to be."""
    links = [case.hand.forward(pose, targets) for pose, targets in case.closings[:CHECKED]]
    for item, (naive, look) in CHECK_ITEMS.items():
        with_it, without = (getattr(check(case.hand, case.visual), look) for check in (naive, PenetrationCheck))
        yield Omission(
            stage="grasp",
            item=item,
            when=when(item),
            object=case.name,
            with_it=partial(depths, with_it, links),
            without=partial(depths, without, links),
            difference=lambda one, other: float(np.abs(one - other).max()),
            unit="m",
        )


def depths(look: Callable[[np.ndarray], float], links: list[np.ndarray]) -> np.ndarray:
    """Depth of each hand (n,), metres."""
    return np.array([look(each) for each in links])
