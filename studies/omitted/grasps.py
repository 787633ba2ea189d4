"""What the scene of a grasp leaves out, what it keeps, and what its model goes without by choice."""

from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import trimesh

from palpate import store
from palpate.batch import generator
from palpate.grasp.closing import GraspScene
from palpate.grasp.grasp import Grasper
from palpate.grasp.patches import surface_patches
from palpate.grasp.penetration import PenetrationCheck
from palpate.hand import Hand
from palpate.mesh import OBJECT_POSITION, load_collision, load_visual
from palpate.scene import SCENES, plan
from studies.omitted.omission import Leaving
from studies.subjects import Subject

CLOSINGS = 4  # an object
CHECKED = 2  # of them, whose ends the check of penetration looks at
# Degrees. Putting in gravity, and what carries it, rounds anew; an object held by forces gives way by less
# than 1e-7 m. The error of the default time step is 0.1 degrees.
ROUNDING, GIVING_WAY = 1e-6, 0.01
BOUNDS = {"gravity": ROUNDING, "object degrees of freedom": GIVING_WAY}
# Parts that the compiled model grows by: they are timed with its compilation.
IN_THE_MODEL = ("visual geometry", "pairs of palm and object", "pairs of object patches")
IN_THE_CHECK = ("faces out of the hand", "links apart")
# Tens of thousands of pairs, at half a second a closing and more: tried on one object, once.
SLOW = "pairs of object patches"
BY_CHOICE = "by choice of the model, not as a saving"
DEFAULT = plan("grasp")


class Scene(NamedTuple):
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


def leavings(run: Path, subjects: list[Subject], settings: Mapping) -> Iterator[Leaving]:
    """The same closings with each part in and out, and the check of where they end.

    The pairs of patches are tried on the object that has the fewest, with one closing.
    settings: `grasps`. Read of the run: meshes, surface and grasps (for the hand).
    """
    scenes = [scene_of(run, subject, settings["grasps"]["timestep"]) for subject in subjects]
    scenes = [scene for scene in scenes if scene.closings]
    for scene in scenes:
        for part in SCENES["grasp"]:
            if part not in (*IN_THE_CHECK, SLOW):
                yield of_closings(scene, part)
        yield from of_check(scene)
    fewest = min(scenes, key=lambda scene: len(scene.patches))
    yield of_closings(fewest._replace(closings=fewest.closings[:1]), SLOW)


def scene_of(run: Path, subject: Subject, timestep: float) -> Scene:
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
    return Scene(subject.name, visual, surface_patches(collision), hand, timestep, closings)


def of_closings(scene: Scene, part: str) -> Leaving:
    """A part of the engine's scene."""
    plans = {"with_it": DEFAULT.including(part), "without": DEFAULT.without(part)}
    compiled = partial(GraspScene, scene.hand, scene.patches, timestep=scene.timestep, visual=scene.visual)
    if part in IN_THE_MODEL:
        calls = {key: lambda plan=plan: ends(compiled(plan=plan), scene) for key, plan in plans.items()}
    else:
        calls = {key: partial(ends, compiled(plan=plan), scene) for key, plan in plans.items()}
    return Leaving(
        scene="grasp",
        part=part,
        when=when(part),
        object=scene.name,
        **calls,
        difference=turned,
        unit="degrees",
        bound=BOUNDS.get(part, 0.0),
        size=lambda found: found.model_bytes,
        left_out=part in DEFAULT.left_out,
    )


def when(part: str) -> str:
    """When a part is left out, in words."""
    if part in DEFAULT.unmodelled:
        return f"always, {BY_CHOICE}: {DEFAULT.unmodelled[part]}"
    return "always" if part in DEFAULT.left_out else f"never: {DEFAULT.kept[part]}"


def ends(engine: GraspScene, scene: Scene) -> Ends:
    """Where the joints end, in each closing."""
    found = []
    for pose, targets in scene.closings:
        engine.place(pose, scene.hand.open_joint_positions)
        found.append(engine.close(targets).joint_positions)
    return Ends(np.array(found), engine.model.nbuffer)


def turned(one: Ends, other: Ends) -> float:
    """Degrees by which any joint ends elsewhere."""
    return float(np.degrees(np.abs(one.joint_positions - other.joint_positions).max()))


def of_check(scene: Scene) -> Iterator[Leaving]:
    """Parts of the check of penetration, on hands at their targets: deeper than they come to be."""
    links = [scene.hand.forward(pose, targets) for pose, targets in scene.closings[:CHECKED]]
    for part, look in (("faces out of the hand", "in_object"), ("links apart", "in_itself")):
        with_it, without = (
            PenetrationCheck(scene.hand, scene.visual, each) for each in (DEFAULT.including(part), DEFAULT)
        )
        yield Leaving(
            scene="grasp",
            part=part,
            when=when(part),
            object=scene.name,
            with_it=partial(depths, getattr(with_it, look), links),
            without=partial(depths, getattr(without, look), links),
            difference=lambda one, other: float(np.abs(one - other).max()),
            unit="m",
            left_out=part in DEFAULT.left_out,
        )


def depths(look: Any, links: list[np.ndarray]) -> np.ndarray:
    """Depth of each hand (n,), metres."""
    return np.array([look(each) for each in links])
