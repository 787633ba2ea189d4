"""Closing the hand: how far from where it comes to rest, and at what cost.

The model of the engine is made before the clock starts; `patches` has what that costs.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
import trimesh

from palpate import mesh, store
from palpate.batch import generator
from palpate.grasp import closing
from palpate.grasp.closing import GraspSimulation
from palpate.grasp.grasp import Grasper
from palpate.grasp.patches import CELL, NARROWEST, surface_patches
from palpate.grasp.penetration import PenetrationCheck
from palpate.hand import Hand
from palpate.touch import RayCaster
from studies.error_vs_runtime.study import Method, Study
from studies.subjects import Subject

CLOSINGS = 3  # of an object, all with the thumb
TIMESTEPS = (1e-4, 5e-4, 1e-3, 2e-3, 4e-3, 5e-3, 7e-3, 1e-2)  # s
DURATIONS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8)  # s
RAMPS = (0.1, 0.2, 0.3, 0.4, 0.6, 0.8)  # shares of the duration
CELLS = (0.01, 0.015, 0.025, 0.05, 0.1)  # m
ITERATIONS = {"newton": (1, 2, 3, 20, 100), "cg": (1, 3, 20), "pgs": (1, 3, 20)}
INTEGRATORS = ("euler", "implicit", "implicitfast", "rk4")
REST = 0.8  # s, in which the reference closes: twice as long changes its joints by 0.002 degrees in the mean
STEP = 1e-4  # s, of the references
THICKNESS = 2e-4  # m, of the reference's pieces
AT_REST = (
    f"hand at rest: closed in {REST} s at {1e3 * STEP} ms, 100 iterations, a piece for every face of the collision mesh"
)
SAME_MOTION = f"same motion: the run's closing at {1e3 * STEP} ms, 100 iterations"
TRUE_SURFACE = "penetration: closed forms against the visual mesh"


@dataclass(frozen=True)
class How:
    """Settings of a closing: seconds, metres, MuJoCo's names in lower case.

    ramp: share of the duration in which the servos' targets move.
    """

    timestep: float
    duration: float
    ramp: float
    cell: float
    integrator: str
    solver: str
    iterations: int


class Closings(NamedTuple):
    """Joint positions (n, J) at the end of each closing, and whether the engine was content with all."""

    joint_positions: np.ndarray
    finite: bool
    how: How


class Case(NamedTuple):
    """An object with palm poses at which the open hand is clear of it, in its own frame.

    Attributes:
        hand: the run's; collision: the decimated mesh.
        poses: (n, 4, 4) of the palm; targets: (n, J) of the servos.
        simulations: by cell size and time step.
        at_rest: (n, J) the reference; same_motion: (n, J) the run's closing in short steps.
        check, caster: of the true surface.
    """

    hand: Hand
    collision: trimesh.Trimesh
    poses: np.ndarray
    targets: np.ndarray
    simulations: dict[tuple[float, float], GraspSimulation]
    at_rest: np.ndarray
    same_motion: np.ndarray
    check: PenetrationCheck
    caster: RayCaster


def library_settings(hand: Hand, timestep: float) -> How:
    """How the library closes a hand at this time step."""
    piece = np.vstack([np.zeros(3), np.eye(3)])
    option = GraspSimulation(hand, [piece], timestep).model.opt
    integrator = mujoco.mjtIntegrator(option.integrator).name.removeprefix("mjINT_").lower()
    solver = mujoco.mjtSolver(option.solver).name.removeprefix("mjSOL_").lower()
    duration, ramp = closing.DURATION, closing.RAMP
    return How(timestep, duration, ramp, CELL, integrator, solver, option.iterations)


def close(simulation: GraspSimulation, poses: np.ndarray, targets: np.ndarray, how: How) -> Closings:
    """Close the hand of a simulation from each palm pose; the simulation has the time step and the cells of `how`."""
    option = simulation.model.opt
    option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{how.integrator.upper()}")
    option.solver = getattr(mujoco.mjtSolver, f"mjSOL_{how.solver.upper()}")
    option.iterations = how.iterations
    steps = max(1, round(how.duration / how.timestep))
    shares = np.minimum(1, np.arange(1, steps + 1) / (how.ramp * steps))
    found, finite = [], True
    for pose, target in zip(poses, targets, strict=True):
        start = simulation.hand.open_joint_positions
        simulation.place(pose, start)
        for share in shares:  # as `GraspSimulation.close` does it, with a ramp of any share
            simulation.data.ctrl[:] = start + share * (target - start)
            mujoco.mj_step(simulation.model, simulation.data)
        found.append(simulation.data.qpos[: len(target)].copy())
        finite &= not any(warning.number for warning in simulation.data.warning)
    joints = np.array(found)
    return Closings(joints, finite and bool(np.isfinite(joints).all()), how)


def face_pieces(collision: trimesh.Trimesh, thickness: float = THICKNESS) -> list[np.ndarray]:
    """Every face of a mesh as a prism (6, 3) of its own, thickened inwards; hairs are left out.

    The limit of ever smaller cells: nothing is rounded off.
    """
    triangles = np.asarray(collision.triangles)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    twice_area = np.linalg.norm(normals, axis=1)
    longest = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2).max(axis=1)
    wide = twice_area > NARROWEST * longest
    triangles, inwards = triangles[wide], -normals[wide] / twice_area[wide, None]
    return list(np.concatenate([triangles, triangles + thickness * inwards[:, None]], axis=1))


def at_rest(hand: Hand, collision: trimesh.Trimesh, poses, targets, how: How, **changes) -> np.ndarray:
    """Joint positions (n, J) to which the hand comes in the end: a slow closing, short steps, every face.

    changes: to this function's constants, to see that they don't matter: `thickness`, and those of `How`.
    """
    pieces = face_pieces(collision, changes.pop("thickness", THICKNESS))
    how = replace(how, **{"timestep": STEP, "duration": REST, "iterations": 100, **changes})
    found = close(GraspSimulation(hand, pieces, how.timestep), poses, targets, how)
    if not found.finite:
        raise RuntimeError(f"the reference closing is unstable: {how}")
    return found.joint_positions


class GraspStudy(Study):
    """Ways to close the hand: place it and close it, `CLOSINGS` times an object.

    `joint`, `tip` and `flipped` are against the hand at rest; `joint, same motion` against the same closing
    time and patches in short steps, which is what time step, integrator and solver alone change.

    Args:
        run: its folder; meshes, surface and grasps (for the hand) are read.
        subjects: objects.
        settings: of the config; `grasps` is read.
    """

    stage = "grasps"
    units = {
        "joint": "deg",
        "tip": "mm",
        "penetration": "mm",
        "flipped": "% of touches",
        "joint, same motion": "deg",
    }
    reference = f"{AT_REST}; {SAME_MOTION}; {TRUE_SURFACE}"

    def __init__(self, run: Path, subjects: Sequence[Subject], settings: Mapping[str, Any]):
        self.run, self.subjects = Path(run), subjects
        self.hand = _hand(self.run, subjects[0].batch)
        self.default = library_settings(self.hand, settings["grasps"]["timestep"])

    def cases(self) -> Iterable[tuple[str, Case]]:
        for subject in self.subjects:
            yield subject.name, self._case(subject)

    def _case(self, subject: Subject) -> Case:
        visual, collision = mesh.load_visual(subject.folder), mesh.load_collision(subject.folder)
        stored = store.read(self.run / f"surface/{subject.batch}.zarr", "object", "points")
        points = stored["points"][list(stored["object"]).index(subject.name)].astype(float)
        grasper = Grasper(visual, collision, points - mesh.OBJECT_POSITION, self.hand)
        poses, targets = placements(grasper, generator(0, subject.name, "closing study"))
        rest = at_rest(self.hand, collision, poses, targets, self.default)
        short = replace(self.default, timestep=STEP, iterations=100)
        simulations = self._simulations(collision, {short, *(how for _, how in self._knobs())})
        same = close(simulations[short.cell, STEP], poses, targets, short).joint_positions
        surface = (grasper.check, grasper.caster)
        return Case(self.hand, collision, poses, targets, simulations, rest, same, *surface)

    def _simulations(self, collision: trimesh.Trimesh, hows: Iterable[How]) -> dict:
        keys = sorted({(how.cell, how.timestep) for how in hows})
        patches = {cell: surface_patches(collision, cell) for cell, _ in keys}
        return {(cell, step): GraspSimulation(self.hand, patches[cell], step) for cell, step in keys}

    def _knobs(self) -> Iterable[tuple[str, How]]:
        """Every knob's settings, the others as in the run."""
        default = self.default
        for field, values in {
            "timestep": TIMESTEPS,
            "duration": DURATIONS,
            "ramp": RAMPS,
            "cell": CELLS,
            "integrator": INTEGRATORS,
        }.items():
            mine = getattr(default, field)
            others = [] if mine in values else [mine]
            yield from ((field, replace(default, **{field: value})) for value in [*values, *others])
        mine = [] if default.iterations in ITERATIONS[default.solver] else [default.iterations]
        for solver, values in ITERATIONS.items():
            for value in [*values, *(mine if solver == default.solver else [])]:
                yield "iterations", replace(default, solver=solver, iterations=value)

    def methods(self) -> list[Method]:
        return [_method(field, how, how == self.default) for field, how in self._knobs()]

    def errors(self, case: Case, result: Closings) -> dict[str, float]:
        """Means over joints, sensors and closings; penetration is the deepest. NaN if the engine warned."""
        if not result.finite:
            return dict.fromkeys(self.units, float("nan"))
        links, right = (case.hand.forward(case.poses, q) for q in (result.joint_positions, case.at_rest))
        sensors, right_sensors = case.hand.sensor_frames(links), case.hand.sensor_frames(right)
        touches, right_touches = (
            np.array([case.caster.succeeds(p, r) for p, r in zip(*frames, strict=True)])
            for frames in (sensors, right_sensors)
        )
        how = result.how
        numerics = {"timestep": 0, "integrator": "", "solver": "", "iterations": 0}
        same = replace(how, **numerics) == replace(self.default, **numerics)

        def degrees(reference: np.ndarray) -> float:
            return float(np.degrees(np.abs(result.joint_positions - reference)).mean())

        return {
            "joint": degrees(case.at_rest),
            "tip": 1e3 * float(np.linalg.norm(sensors[0] - right_sensors[0], axis=-1).mean()),
            "penetration": 1e3 * max(case.check.in_object(each) for each in links),
            "flipped": 100 * float((touches != right_touches).mean()),
            "joint, same motion": degrees(case.same_motion) if same else float("nan"),
        }


# By field of `How`: the knob in words, and its value as it is reported.
KNOBS: dict[str, tuple[str, Callable[[How], Any]]] = {
    "timestep": ("time step, ms", lambda how: round(1e3 * how.timestep, 6)),
    "duration": ("closing time, s", lambda how: how.duration),
    "ramp": ("ramp, share of the closing time", lambda how: how.ramp),
    "cell": ("cell, mm (model not timed)", lambda how: round(1e3 * how.cell, 6)),
    "integrator": ("integrator", lambda how: how.integrator),
    "iterations": ("iterations", lambda how: how.iterations),
}


def _method(field: str, how: How, chosen: bool) -> Method:
    knob, value = KNOBS[field]

    def run(case: Case) -> Closings:
        return close(case.simulations[how.cell, how.timestep], case.poses, case.targets, how)

    name = f"closing, solver {how.solver}" if field == "iterations" else "closing"
    return Method(name, knob, value(how), run, chosen)


def placements(grasper: Grasper, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Palm poses (n, 4, 4) clear of the object, and targets (n, J) of the closings from there.

    Raises ValueError if there is no such pose.
    """
    poses = [grasper.free_palm_pose(rng) for _ in range(CLOSINGS)]
    poses = [pose for pose in poses if pose is not None]
    if not poses:
        raise ValueError("no palm pose is free of the object: nothing can be closed")
    return np.array(poses), np.array([grasper.workspace.targets(pose, grasper.surface) for pose in poses])


def _hand(run: Path, batch: str) -> Hand:
    """The hand that made a run's grasps."""
    arrays = store.read(run / f"grasps/{batch}.h5")
    return Hand.from_arrays(arrays, prefix="hand/")


def study(run: Path, subjects: Sequence[Subject], settings: Mapping[str, Any]) -> GraspStudy:
    """The study of a run; `settings`: `grasps` of the config."""
    return GraspStudy(run, subjects, settings)
