"""Closing the hand: distance of the final joints from those at rest, against time.

The engine's model is built before the clock starts; `patches` measures the time for that.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
import trimesh

from palpate import mesh
from palpate.batch import generator
from palpate.grasp import closing
from palpate.grasp.closing import GraspSimulation
from palpate.grasp.contacts import OBJECT, contacts
from palpate.grasp.grasp import Grasper
from palpate.grasp.patches import CELL, NARROWEST, surface_patches
from palpate.hand import Hand
from studies.error_vs_runtime.study import Method, Study
from studies.grasping import find_closings, grasper_of, hand_of
from studies.subjects import Subject

CLOSINGS = 3  # of an object, all with the thumb

# By field of `ClosingSettings`: its name in the report, its values, and the factor to its unit there.
KNOBS: dict[str, tuple[str, tuple, float | None]] = {
    "timestep": ("time step, ms", (1e-4, 5e-4, 1e-3, 2e-3, 4e-3, 5e-3, 7e-3, 1e-2), 1e3),
    "duration": ("closing time, s", (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8), None),
    "ramp": ("ramp, share of the closing time", (0.1, 0.2, 0.3, 0.4, 0.6, 0.8), None),
    "cell": ("cell, mm (model not timed)", (0.01, 0.015, 0.025, 0.05, 0.1), 1e3),
    "integrator": ("integrator", ("euler", "implicit", "implicitfast", "rk4"), None),
    "iterations": ("iterations", (1, 2, 3, 20, 100), None),
}
REST_DURATION = 0.8  # s, of the reference's closing: doubling it changes joints by 0.002 degrees in the mean
REFERENCE_TIMESTEP = 1e-4  # s, of the references
THICKNESS = 2e-4  # m, of the reference's pieces


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
    iterations: int


class Closings(NamedTuple):
    """Joint positions (n, J) and sum of forces on the object (n,), N, at the end, and whether all were stable."""

    joint_positions: np.ndarray
    finite: bool
    setup: ClosingSettings
    force: np.ndarray


class Case(NamedTuple):
    """An object with palm poses (n, 4, 4) of the open hand in its frame, clear of it, and servo targets (n, J).

    simulations: by cell size and time step. at_rest: (n, J) the reference; same_motion: (n, J) the run's closing in
    short steps; its `force` is the reference of forces.
    """

    grasper: Grasper
    collision: trimesh.Trimesh
    poses: np.ndarray
    targets: np.ndarray
    simulations: dict[tuple[float, float], GraspSimulation]
    at_rest: np.ndarray
    same_motion: np.ndarray
    force: np.ndarray


def library_settings(hand: Hand, timestep: float) -> ClosingSettings:
    """The library's settings of a closing, at a time step in seconds."""
    option = GraspSimulation(hand, [np.vstack([np.zeros(3), np.eye(3)])], timestep).model.opt
    integrator = mujoco.mjtIntegrator(option.integrator).name.removeprefix("mjINT_").lower()
    return ClosingSettings(timestep, closing.DURATION, closing.RAMP, CELL, integrator, option.iterations)


def close(simulation: GraspSimulation, poses: np.ndarray, targets: np.ndarray, setup: ClosingSettings) -> Closings:
    """Close the hand from each palm pose, in a simulation with the time step and the cells of `setup`."""
    option = simulation.model.opt
    option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{setup.integrator.upper()}")
    option.iterations = setup.iterations
    steps = max(1, round(setup.duration / setup.timestep))
    shares = np.minimum(1, np.arange(1, steps + 1) / (setup.ramp * steps))
    ends, forces, finite = [], [], True
    for pose, target in zip(poses, targets, strict=True):
        start = simulation.hand.open_joint_positions
        simulation.place(pose, start)
        for share in shares:  # as `GraspSimulation.close` does it, with a ramp of any share
            simulation.data.ctrl[:] = start + share * (target - start)
            mujoco.mj_step(simulation.model, simulation.data)
        ends.append(simulation.data.qpos[: len(target)].copy())
        found = contacts(simulation)
        forces.append(found.force[found.other == OBJECT].sum())
        finite &= not any(warning.number for warning in simulation.data.warning)
    joints = np.array(ends)
    return Closings(joints, finite and bool(np.isfinite(joints).all()), setup, np.array(forces))


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
    """Ways to close the hand: place it and close it, `CLOSINGS` times an object. settings: `grasps` of the config.

    `joint`, `tip` and `flipped` are relative to the hand at rest. `joint, same motion` is relative to a closing of
    the same duration and patches in short time steps: the effect of time step, integrator and iterations alone.
    """

    stage = "grasps"
    units = {"joint": "deg", "tip": "mm", "penetration": "mm", "flipped": "% of touches", "joint, same motion": "deg"}
    units |= {"force, same motion": "N"}
    reference = (
        f"hand at rest: closed in {REST_DURATION} s at {1e3 * REFERENCE_TIMESTEP} ms, 100 iterations, a piece for "
        f"every face of the collision mesh; same motion: the run's closing at {1e3 * REFERENCE_TIMESTEP} ms, 100 "
        "iterations; penetration: closed forms against the visual mesh"
    )

    def __init__(self, run: Path, subjects: Sequence[Subject], settings: Mapping[str, Any]):
        super().__init__(run, subjects, settings)
        self.default = library_settings(hand_of(run, subjects[0].batch), settings["grasps"]["timestep"])

    def case(self, subject: Subject) -> Case:
        """Raises ValueError if no palm pose is free of the object."""
        collision, grasper = mesh.load_collision(subject.folder), grasper_of(self.run, subject)
        found = find_closings(grasper, generator(0, subject.name, "closing study"), CLOSINGS)
        if not found:
            raise ValueError("no palm pose is free of the object: nothing can be closed")
        poses, targets = map(np.array, zip(*found, strict=True))
        rest = at_rest(grasper.hand, collision, poses, targets, self.default)
        short = replace(self.default, timestep=REFERENCE_TIMESTEP, iterations=100)
        keys = sorted({(setup.cell, setup.timestep) for setup in (short, *(setup for _, setup in self._knobs()))})
        patches = {cell: surface_patches(collision, cell) for cell, _ in keys}
        simulations = {(cell, step): GraspSimulation(grasper.hand, patches[cell], step) for cell, step in keys}
        same = close(simulations[short.cell, REFERENCE_TIMESTEP], poses, targets, short)
        return Case(grasper, collision, poses, targets, simulations, rest, same.joint_positions, same.force)

    def _knobs(self) -> Iterable[tuple[str, ClosingSettings]]:
        """Settings with one knob changed, for every value of every knob; the run's own comes last if it is another."""
        for field, (_, values, _) in KNOBS.items():
            for value in dict.fromkeys([*values, getattr(self.default, field)]):
                yield field, replace(self.default, **{field: value})

    def methods(self) -> list[Method]:
        methods = []
        for field, setup in self._knobs():
            (knob, _, factor), value = KNOBS[field], getattr(setup, field)
            shown = round(factor * value, 6) if factor else value
            methods.append(Method("closing", knob, shown, partial(_run, setup), setup == self.default))
        return methods

    def errors(self, case: Case, result: Closings) -> dict[str, float]:
        """Means over joints, sensors and closings; penetration is the deepest. NaN if the engine warned."""
        if not result.finite:
            return dict.fromkeys(self.units, float("nan"))
        links, right = (case.grasper.hand.forward(case.poses, q) for q in (result.joint_positions, case.at_rest))
        frames = [case.grasper.hand.sensor_frames(each) for each in (links, right)]
        touches = [[case.grasper.caster.succeeds(p, r) for p, r in zip(*each, strict=True)] for each in frames]
        numerics = {"timestep": 0, "integrator": "", "iterations": 0}
        same = replace(result.setup, **numerics) == replace(self.default, **numerics)

        def degrees(reference: np.ndarray) -> float:
            return float(np.degrees(np.abs(result.joint_positions - reference)).mean())

        values = (
            degrees(case.at_rest),
            1e3 * float(np.linalg.norm(frames[0][0] - frames[1][0], axis=-1).mean()),
            1e3 * max(case.grasper.check.in_object(each) for each in links),
            100 * float((np.array(touches[0]) != np.array(touches[1])).mean()),
            degrees(case.same_motion) if same else float("nan"),
            float(np.abs(result.force - case.force).mean()) if same else float("nan"),
        )
        return dict(zip(GraspStudy.units, values, strict=True))


def _run(setup: ClosingSettings, case: Case) -> Closings:
    return close(case.simulations[setup.cell, setup.timestep], case.poses, case.targets, setup)


study = GraspStudy
