"""Closing the hand: distance of the final joints from those at rest, against time.

The engine's model is built before the clock starts; `patches` measures the time for that.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

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
from palpate.hand.model import STIFFNESS
from studies.error_vs_runtime.study import Method, Study
from studies.grasping import find_closings, grasper_of
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
    "contact": ("time constant of contacts, time steps", (2, 4, 8, 16, 32), None),
    "gain": ("servo gain, N m / rad", (0.1, 0.3, 1, 3, 10), None),
}
REST_DURATION = 0.8  # s, of the reference's closing: doubling it changes joints by 0.002 degrees in the mean
REFERENCE_TIMESTEP = 1e-4  # s, of the references
FORCE_DURATION = 4e-3  # s at the end whose forces are averaged: in shorter steps contacts come and go from step to step
THICKNESS = 2e-4  # m, of the reference's pieces


@dataclass(frozen=True)
class ClosingSettings:
    """Settings of a closing, by default the library's: seconds, metres, MuJoCo's names in lower case.

    ramp: share of the duration during which the servos' targets move. contact: time constant of contacts, time steps;
    the engine takes fewer than 2 as 2. gain: of the servos, N m / rad.
    """

    timestep: float
    duration: float = closing.DURATION
    ramp: float = closing.RAMP
    cell: float = CELL
    integrator: str = "implicitfast"
    iterations: int = closing.ITERATIONS
    contact: float = 2
    gain: float = STIFFNESS


class Closings(NamedTuple):
    """Joint positions (n, J) and sum of forces on the object (n,), N, at the end, and whether all were stable.

    Forces are means over the steps of the last `FORCE_DURATION`, or of the last step if it is longer.
    """

    joint_positions: np.ndarray
    finite: bool
    setup: ClosingSettings
    force: np.ndarray


class Case(NamedTuple):
    """An object with palm poses (n, 4, 4) of the open hand in its frame, clear of it, and servo targets (n, J).

    simulations: by cell size, time step and gain. at_rest, same_motion: the references, the hand at rest and the run's
    closing in short steps.
    """

    grasper: Grasper
    collision: trimesh.Trimesh
    poses: np.ndarray
    targets: np.ndarray
    simulations: dict[tuple[float, float, float], GraspSimulation]
    at_rest: Closings
    same_motion: Closings


def close(simulation: GraspSimulation, poses: np.ndarray, targets: np.ndarray, setup: ClosingSettings) -> Closings:
    """Close the hand from each palm pose, in a simulation with the time step, cells and gain of `setup`."""
    option = simulation.model.opt
    option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{setup.integrator.upper()}")
    option.iterations = setup.iterations
    simulation.model.geom_solref[:, 0] = setup.contact * setup.timestep
    steps = max(1, round(setup.duration / setup.timestep))
    shares = np.minimum(1, np.arange(1, steps + 1) / (setup.ramp * steps))
    ends, forces, finite = [], [], True
    for pose, target in zip(poses, targets, strict=True):
        start, pressed = simulation.hand.open_joint_positions, []
        simulation.place(pose, start)
        for step, share in enumerate(shares, start=1):  # as `GraspSimulation.close` does it, with a ramp of any share
            simulation.data.ctrl[:] = start + share * (target - start)
            mujoco.mj_step(simulation.model, simulation.data)
            if step > steps - max(1, round(FORCE_DURATION / setup.timestep)):
                touching = contacts(simulation)
                pressed.append(touching.force[touching.other == OBJECT].sum())
        ends.append(simulation.data.qpos[: len(target)].copy())
        forces.append(np.mean(pressed))
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


def at_rest(hand: Hand, collision: trimesh.Trimesh, poses, targets, setup: ClosingSettings, **changes) -> Closings:
    """The hand at rest: a slow closing with short time steps, on every face.

    changes: replace this function's constants, `thickness` and fields of `ClosingSettings`, to test their effect.
    """
    pieces = face_pieces(collision, changes.pop("thickness", THICKNESS))
    setup = replace(setup, **{"timestep": REFERENCE_TIMESTEP, "duration": REST_DURATION, "iterations": 100, **changes})
    rest = close(GraspSimulation(hand, pieces, setup.timestep, stiffness=setup.gain), poses, targets, setup)
    if not rest.finite:
        raise RuntimeError(f"the reference closing is unstable: {setup}")
    return rest


class GraspStudy(Study):
    """Ways to close the hand: place it and close it, `CLOSINGS` times an object. settings: `grasps` of the config.

    `joint`, `tip`, `flipped` and `force` are relative to the hand at rest; forces are sums over the contacts with the
    object. `force over gain` compares forces at the run's gain, if they are proportional to it. `same motion` is
    relative to a closing of the same duration, patches and gain in short time steps with stiff contacts: the effect of
    time step, integrator, iterations and softer contacts alone.
    """

    stage = "grasps"
    units = {"joint": "deg", "tip": "mm", "penetration": "mm", "flipped": "% of touches", "joint, same motion": "deg"}
    units |= dict.fromkeys(("force, same motion", "force", "force over gain"), "N")
    reference = (
        f"hand at rest: closed in {REST_DURATION} s at {1e3 * REFERENCE_TIMESTEP} ms, 100 iterations, a piece for "
        f"every face of the collision mesh; same motion: the run's closing at {1e3 * REFERENCE_TIMESTEP} ms, 100 "
        "iterations; penetration: closed forms against the visual mesh"
    )

    @property
    def default(self) -> ClosingSettings:
        """The run's settings."""
        return ClosingSettings(self.settings["grasps"]["timestep"])

    def case(self, subject: Subject) -> Case:
        """Closings of the object with their references. Raises ValueError if no palm pose is free of the object."""
        collision, grasper = mesh.load_collision(subject.folder), grasper_of(self.run, subject)
        closings = find_closings(grasper, generator(0, subject.name, "closing study"), CLOSINGS)
        if not closings:
            raise ValueError("no palm pose is free of the object: nothing can be closed")
        poses, targets = map(np.array, zip(*closings, strict=True))
        rest = at_rest(grasper.hand, collision, poses, targets, self.default)
        short = replace(self.default, timestep=REFERENCE_TIMESTEP, iterations=100)
        keys = sorted({_engine(setup) for setup in (short, *(setup for _, setup in self._knobs()))})
        patches = {cell: surface_patches(collision, cell) for cell, *_ in keys}
        simulations = {
            (cell, step, gain): GraspSimulation(grasper.hand, patches[cell], step, stiffness=gain)
            for cell, step, gain in keys
        }
        same = close(simulations[_engine(short)], poses, targets, short)
        return Case(grasper, collision, poses, targets, simulations, rest, same)

    def _knobs(self) -> Iterable[tuple[str, ClosingSettings]]:
        """Settings with one knob changed, for every value of every knob; the run's own comes last if it is another."""
        for field, (_, values, _) in KNOBS.items():
            for value in dict.fromkeys([*values, getattr(self.default, field)]):
                yield field, replace(self.default, **{field: value})

    def methods(self) -> list[Method]:
        """A method for every value of every knob."""
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
        links, right = (
            case.grasper.hand.forward(case.poses, q) for q in (result.joint_positions, case.at_rest.joint_positions)
        )
        frames = [case.grasper.hand.sensor_frames(poses) for poses in (links, right)]
        touches = [[case.grasper.caster.succeeds(p, r) for p, r in zip(*sensors, strict=True)] for sensors in frames]
        numerics = {"timestep": 0, "integrator": "", "iterations": 0, "contact": 0}
        same = replace(result.setup, **numerics) == replace(self.default, **numerics)

        def degrees(reference: Closings) -> float:
            return float(np.degrees(np.abs(result.joint_positions - reference.joint_positions)).mean())

        def newtons(reference: Closings, scale: float = 1) -> float:
            return float(np.abs(scale * result.force - reference.force).mean())

        values = (
            degrees(case.at_rest),
            1e3 * float(np.linalg.norm(frames[0][0] - frames[1][0], axis=-1).mean()),
            1e3 * max(case.grasper.check.in_object(pose) for pose in links),
            100 * float((np.array(touches[0]) != np.array(touches[1])).mean()),
            degrees(case.same_motion) if same else float("nan"),
            newtons(case.same_motion) if same else float("nan"),
            newtons(case.at_rest),
            newtons(case.at_rest, self.default.gain / result.setup.gain),
        )
        return dict(zip(GraspStudy.units, values, strict=True))


def _run(setup: ClosingSettings, case: Case) -> Closings:
    return close(case.simulations[_engine(setup)], case.poses, case.targets, setup)


def _engine(setup: ClosingSettings) -> tuple[float, float, float]:
    """The properties that a model is compiled for: cell size, time step and gain."""
    return setup.cell, setup.timestep, setup.gain


study = GraspStudy
