"""Closing the hand: distance of the final joints from those at rest, against time.

The engine's model is built before the clock starts; `patches` measures the time for that.
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
from studies.scenes import hand_of
from studies.subjects import Subject

CLOSINGS = 3  # of an object, all with the thumb
TIMESTEPS = (1e-4, 5e-4, 1e-3, 2e-3, 4e-3, 5e-3, 7e-3, 1e-2)  # s
DURATIONS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8)  # s
RAMPS = (0.1, 0.2, 0.3, 0.4, 0.6, 0.8)  # shares of the duration
CELLS = (0.01, 0.015, 0.025, 0.05, 0.1)  # m
ITERATIONS = {"newton": (1, 2, 3, 20, 100), "cg": (1, 3, 20), "pgs": (1, 3, 20)}
INTEGRATORS = ("euler", "implicit", "implicitfast", "rk4")
REST_DURATION = 0.8  # s, of the reference's closing: doubling it changes joints by 0.002 degrees in the mean
REFERENCE_TIMESTEP = 1e-4  # s, of the references
THICKNESS = 2e-4  # m, of the reference's pieces
AT_REST = (
    f"hand at rest: closed in {REST_DURATION} s at {1e3 * REFERENCE_TIMESTEP} ms, 100 iterations, "
    "a piece for every face of the collision mesh"
)
SAME_MOTION = f"same motion: the run's closing at {1e3 * REFERENCE_TIMESTEP} ms, 100 iterations"
TRUE_SURFACE = "penetration: closed forms against the visual mesh"


@dataclass(frozen=True)
class ClosingSettings:
    """Settings of a closing: seconds, metres, MuJoCo's names in lower case.

    ramp: share of the duration during which the servos' targets move.
    """

    timestep: float
    duration: float
    ramp: float
    cell: float
    integrator: str
    solver: str
    iterations: int


class Closings(NamedTuple):
    """Joint positions (n, J) at the end of each closing, and whether all were stable and finite."""

    joint_positions: np.ndarray
    finite: bool
    setup: ClosingSettings


class Case(NamedTuple):
    """An object with collision-free palm poses of the open hand, in the object's frame.

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


def library_settings(hand: Hand, timestep: float) -> ClosingSettings:
    """The library's settings of a closing, at a time step in seconds."""
    piece = np.vstack([np.zeros(3), np.eye(3)])
    option = GraspSimulation(hand, [piece], timestep).model.opt
    integrator = mujoco.mjtIntegrator(option.integrator).name.removeprefix("mjINT_").lower()
    solver = mujoco.mjtSolver(option.solver).name.removeprefix("mjSOL_").lower()
    duration, ramp = closing.DURATION, closing.RAMP
    return ClosingSettings(timestep, duration, ramp, CELL, integrator, solver, option.iterations)


def close(simulation: GraspSimulation, poses: np.ndarray, targets: np.ndarray, setup: ClosingSettings) -> Closings:
    """Close the hand from each palm pose, in a simulation with the time step and the cells of `setup`."""
    option = simulation.model.opt
    option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{setup.integrator.upper()}")
    option.solver = getattr(mujoco.mjtSolver, f"mjSOL_{setup.solver.upper()}")
    option.iterations = setup.iterations
    steps = max(1, round(setup.duration / setup.timestep))
    shares = np.minimum(1, np.arange(1, steps + 1) / (setup.ramp * steps))
    ends, finite = [], True
    for pose, target in zip(poses, targets, strict=True):
        start = simulation.hand.open_joint_positions
        simulation.place(pose, start)
        for share in shares:  # as `GraspSimulation.close` does it, with a ramp of any share
            simulation.data.ctrl[:] = start + share * (target - start)
            mujoco.mj_step(simulation.model, simulation.data)
        ends.append(simulation.data.qpos[: len(target)].copy())
        finite &= not any(warning.number for warning in simulation.data.warning)
    joints = np.array(ends)
    return Closings(joints, finite and bool(np.isfinite(joints).all()), setup)


def face_pieces(collision: trimesh.Trimesh, thickness: float = THICKNESS) -> list[np.ndarray]:
    """Every face of a mesh as a prism (6, 3), thickened inwards; faces narrower than `NARROWEST` are omitted.

    This is the limit of ever smaller cells: nothing is rounded off.
    """
    triangles = np.asarray(collision.triangles)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    twice_area = np.linalg.norm(normals, axis=1)
    longest = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2).max(axis=1)
    wide = twice_area > NARROWEST * longest
    triangles, inwards = triangles[wide], -normals[wide] / twice_area[wide, None]
    return list(np.concatenate([triangles, triangles + thickness * inwards[:, None]], axis=1))


def at_rest(hand: Hand, collision: trimesh.Trimesh, poses, targets, setup: ClosingSettings, **changes) -> np.ndarray:
    """Joint positions (n, J) of the hand at rest: a slow closing with short time steps, on every face.

    changes: replace this function's constants, `thickness` and fields of `ClosingSettings`, to test their effect.
    """
    pieces = face_pieces(collision, changes.pop("thickness", THICKNESS))
    setup = replace(setup, **{"timestep": REFERENCE_TIMESTEP, "duration": REST_DURATION, "iterations": 100, **changes})
    rest = close(GraspSimulation(hand, pieces, setup.timestep), poses, targets, setup)
    if not rest.finite:
        raise RuntimeError(f"the reference closing is unstable: {setup}")
    return rest.joint_positions


class GraspStudy(Study):
    """Ways to close the hand: place it and close it, `CLOSINGS` times an object.

    `joint`, `tip` and `flipped` are relative to the hand at rest. `joint, same motion` is relative to a closing of
    the same duration and patches in short time steps: the effect of time step, integrator and solver alone.

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
        self.hand = hand_of(self.run, subjects[0].batch)
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
        short = replace(self.default, timestep=REFERENCE_TIMESTEP, iterations=100)
        simulations = self._simulations(collision, {short, *(setup for _, setup in self._knobs())})
        same = close(simulations[short.cell, REFERENCE_TIMESTEP], poses, targets, short).joint_positions
        surface = (grasper.check, grasper.caster)
        return Case(self.hand, collision, poses, targets, simulations, rest, same, *surface)

    def _simulations(self, collision: trimesh.Trimesh, setups: Iterable[ClosingSettings]) -> dict:
        keys = sorted({(setup.cell, setup.timestep) for setup in setups})
        patches = {cell: surface_patches(collision, cell) for cell, _ in keys}
        return {(cell, step): GraspSimulation(self.hand, patches[cell], step) for cell, step in keys}

    def _knobs(self) -> Iterable[tuple[str, ClosingSettings]]:
        """Settings with one knob changed, for every value of every knob."""
        default = self.default
        for field, values in {
            "timestep": TIMESTEPS,
            "duration": DURATIONS,
            "ramp": RAMPS,
            "cell": CELLS,
            "integrator": INTEGRATORS,
        }.items():
            own = getattr(default, field)
            others = [] if own in values else [own]
            yield from ((field, replace(default, **{field: value})) for value in [*values, *others])
        own = [] if default.iterations in ITERATIONS[default.solver] else [default.iterations]
        for solver, values in ITERATIONS.items():
            for value in [*values, *(own if solver == default.solver else [])]:
                yield "iterations", replace(default, solver=solver, iterations=value)

    def methods(self) -> list[Method]:
        return [_method(field, setup, setup == self.default) for field, setup in self._knobs()]

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
        setup = result.setup
        numerics = {"timestep": 0, "integrator": "", "solver": "", "iterations": 0}
        same = replace(setup, **numerics) == replace(self.default, **numerics)

        def degrees(reference: np.ndarray) -> float:
            return float(np.degrees(np.abs(result.joint_positions - reference)).mean())

        return {
            "joint": degrees(case.at_rest),
            "tip": 1e3 * float(np.linalg.norm(sensors[0] - right_sensors[0], axis=-1).mean()),
            "penetration": 1e3 * max(case.check.in_object(each) for each in links),
            "flipped": 100 * float((touches != right_touches).mean()),
            "joint, same motion": degrees(case.same_motion) if same else float("nan"),
        }


# By field of `ClosingSettings`: the knob's name in the report, and its value there.
KNOBS: dict[str, tuple[str, Callable[[ClosingSettings], Any]]] = {
    "timestep": ("time step, ms", lambda setup: round(1e3 * setup.timestep, 6)),
    "duration": ("closing time, s", lambda setup: setup.duration),
    "ramp": ("ramp, share of the closing time", lambda setup: setup.ramp),
    "cell": ("cell, mm (model not timed)", lambda setup: round(1e3 * setup.cell, 6)),
    "integrator": ("integrator", lambda setup: setup.integrator),
    "iterations": ("iterations", lambda setup: setup.iterations),
}


def _method(field: str, setup: ClosingSettings, chosen: bool) -> Method:
    knob, value = KNOBS[field]

    def run(case: Case) -> Closings:
        return close(case.simulations[setup.cell, setup.timestep], case.poses, case.targets, setup)

    name = f"closing, solver {setup.solver}" if field == "iterations" else "closing"
    return Method(name, knob, value(setup), run, chosen)


def placements(grasper: Grasper, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Collision-free palm poses (n, 4, 4), and targets (n, J) of the closings from there.

    Raises ValueError if there is no such pose.
    """
    poses = [grasper.free_palm_pose(rng) for _ in range(CLOSINGS)]
    poses = [pose for pose in poses if pose is not None]
    if not poses:
        raise ValueError("no palm pose is free of the object: nothing can be closed")
    return np.array(poses), np.array([grasper.workspace.targets(pose, grasper.surface) for pose in poses])


def study(run: Path, subjects: Sequence[Subject], settings: Mapping[str, Any]) -> GraspStudy:
    """The study of a run; `settings`: `grasps` of the config."""
    return GraspStudy(run, subjects, settings)
