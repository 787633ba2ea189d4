"""Stability of grasps: stiff and extreme contact in the engine, the grasper and the penetration check.

By default closings are those of an object of the run: three collision-free palm poses, all fingers closing.

Bounds:

- `MAX_PENETRATION`, 1 mm: the penetration that config/config.yaml allows a grasp.
- `JOINT_TOLERANCE`: the joint angle that moves a fingertip by 1 mm.
- `GEL_TOLERANCE`: the joint angle that moves it by the gel's 3.2 mm. It applies where the path of a finger changes, so
  that it may come to rest elsewhere.
- Kinetic energy must not exceed the servos' work, its only source.

Depths are those of `palpate.grasp.penetration`, between true surfaces, not the engine's.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import mujoco
import numpy as np

from palpate.grasp.closing import GraspSimulation
from palpate.grasp.grasp import OUT_OF_RANGE, PENETRATING, UNSETTLED, UNSTABLE
from palpate.grasp.patches import surface_patches
from palpate.hand import MAX_PENETRATION
from palpate.mesh import load_collision
from studies.stability import shapes
from studies.stability.cases import REJECTED, Cases, Finding, at_most, equal
from studies.stability.closings import (
    GEL_TOLERANCE,
    HAND,
    JOINT_TOLERANCE,
    ClosingSetup,
    RecordedClosing,
    closing_setup,
    hold_targets,
    joint_change,
    joints_agree,
    soundness,
)

CASES = Cases()
STAGE = "grasps"
TIMESTEPS = (0.008, 0.004, 0.002, 0.001, 0.0005)  # s
# The grasper's reasons to take no closing, but for those that touch nothing.
REFUSED = (UNSTABLE, UNSETTLED, OUT_OF_RANGE, PENETRATING)
Change = Callable[[GraspSimulation], None]


def setting(safe: bool = True, **values: Any) -> Change:
    """Set fields of the model; safe: keep the engine's `refsafe` on.

    solref: time constant (s) and damping ratio, solimp: impedances at depth 0 and at `width` (m), `width`, midpoint and
    power, both of contacts and joint limits.
    """

    def edit(simulation: GraspSimulation) -> None:
        for name, value in values.items():
            names = (f"geom_{name}", f"jnt_{name}") if name in ("solref", "solimp") else (name,)
            for array in names:
                getattr(simulation.model, array)[:] = value
        if not safe:
            simulation.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_REFSAFE

    return edit


def gains(factor: float, torque: float = 1.0) -> Change:
    """Scale the servos' gain, critically damped as before, and their torque limit."""

    def edit(simulation: GraspSimulation) -> None:
        model = simulation.model
        model.actuator_gainprm[:, 0] *= factor
        model.actuator_biasprm[:, 1] *= factor
        model.actuator_biasprm[:, 2] *= np.sqrt(factor)
        model.actuator_forcerange[:] *= torque

    return edit


def mass(factor: float, links: str = "") -> Change:
    """Scale mass and inertia of the links whose names contain `links`; `palpate.hand.model` would not allow it."""

    def edit(simulation: GraspSimulation) -> None:
        model = simulation.model
        chosen = [body for body in range(model.nbody) if links in model.body(body).name]
        model.body_mass[chosen] *= factor
        model.body_inertia[chosen] *= factor
        mujoco.mj_setConst(model, mujoco.MjData(model))

    return edit


def faster_closing(factor: float) -> Change:
    """Reach the targets `factor` times as fast, then hold them for the rest of the time."""

    def edit(simulation: GraspSimulation) -> None:
        simulation.ramp = np.minimum(1.0, factor * simulation.ramp)

    return edit


def combined(*changes: Change) -> Change:
    """Apply several changes in order."""
    return lambda simulation: [change(simulation) for change in changes]


def plate_setup() -> ClosingSetup:
    """The middle finger bending onto a plate."""
    return shapes.shape_setup(shapes.placed_at_pad(shapes.plate(), shapes.bent_finger()))


def none_accepted(recorded: Sequence[RecordedClosing], what: str) -> Finding:
    """Finding: the grasper accepts no closing."""
    accepted = [closing for closing in recorded if closing.outcome not in REFUSED]
    note = ", ".join(sorted({closing.outcome for closing in recorded}))
    finding = equal(f"{what}: closings taken", len(accepted), 0, note=note)
    return finding if accepted else finding._replace(verdict=REJECTED)


def no_unsound_accepted(recorded: Sequence[RecordedClosing], what: str) -> Finding:
    """Finding: the grasper accepts no closing with engine warnings or with more kinetic energy than servo work."""
    unsound = [
        closing
        for closing in recorded
        if closing.outcome not in REFUSED and (closing.warnings or closing.energy_gain > 1)
    ]
    note = ", ".join(closing.outcome for closing in recorded)
    return equal(f"{what}: unsound closings taken", len(unsound), 0, note=note)


def converges(ends: Sequence[Sequence[RecordedClosing]], what: str) -> Finding:
    """Finding: joint changes halve with each halving of a parameter, within a factor of two overall.

    ends: the same closings at each value of the parameter. The median closing counts.
    """
    pairs = [zip(*two, strict=True) for two in zip(ends, ends[1:], strict=False)]
    middle = [float(np.median([joint_change(*pair) for pair in two])) for two in pairs]
    note = ", ".join(f"{change:.1e}" for change in middle) + " rad"
    bound = 2 * 0.5 ** (len(middle) - 1)
    return at_most(f"{what}: last change over first", middle[-1] / middle[0], bound, note=note)


@CASES.case("solref at the time step and below", STAGE)
def solref_at_the_time_step(subject) -> Iterator[Finding]:
    """The engine's `refsafe` raises any time constant below two steps to two steps, Palpate's default.

    Without it contact is stable down to a time constant of about a step; below, it creates energy.
    """
    setup = closing_setup(subject)
    mild, step = setup.record(), setup.grasper.simulation.model.opt.timestep
    for steps in (1, 0.1, 1e-3):
        hard = setup.record(setting(solref=(steps * step, 1)))
        yield equal(f"joints' change at {steps:g} steps", max(map(joint_change, hard, mild)), 0.0, "rad")
    yield from soundness(mild)
    for steps, judge in ((0.5, no_unsound_accepted), (0.1, none_accepted), (1e-3, none_accepted)):
        yield judge(setup.record(setting(safe=False, solref=(steps * step, 1))), f"refsafe off, {steps:g} steps")


@CASES.case("solimp extremes", STAGE)
def solimp_extremes(subject) -> Iterator[Finding]:
    """Contacts that become hard at once, late, or never."""
    setup = closing_setup(subject)
    mild = setup.record()
    hard = {
        "impedance 1": (1, 1, 0.0005, 0.5, 2),
        "width 1 nm": (0.1, 0.99, 1e-9, 0.5, 2),
        "midpoint 1, power 50": (0.1, 0.99, 0.0005, 1, 50),
    }
    recorded = {name: setup.record(setting(solimp=values), name) for name, values in hard.items()}
    yield from soundness([closing for of in recorded.values() for closing in of])
    for name, of in recorded.items():
        yield joints_agree(of, mild, what=f"{name}: joints' change")
    yield no_unsound_accepted(setup.record(setting(solimp=(0, 0, 0.001, 0.5, 2))), "impedance 0")


@CASES.case("servos' gains x100", STAGE)
def gains_times_100(subject) -> Iterator[Finding]:
    """The torque limit of 0.5 N m bounds the force. Final poses differ where an object stops the fingers."""
    setup = closing_setup(subject)
    free = setup.record(gains(100), "x100")
    yield from soundness(free, what="torque limited")
    yield no_unsound_accepted(setup.record(gains(100, torque=100)), "torque x100")
    distant_ball = shapes.shape_setup(shapes.distant_ball())
    ends = distant_ball.record(combined(gains(100), hold_targets)), distant_ball.record(hold_targets)
    yield joints_agree(*ends, what="nothing in the way: joints' change")


@CASES.case("masses 1e-4 to 1e4, armature to 0", STAGE)
def inertia(subject) -> Iterator[Finding]:
    """Light hands rest where the default does, heavy ones don't come to rest.

    Without armature only the links' own inertia remains, 1e-5 kg m^2 at a finger's base; the servos' damping stays.
    """
    setup, plate = closing_setup(subject), plate_setup()
    mild, on_plate = setup.record(hold_targets), plate.record(hold_targets)
    changes = {"masses x1e-4": mass(1e-4), "tips x1e-4": mass(1e-4, "_tip"), "armature 0": setting(dof_armature=0)}
    for what, change in changes.items():
        light = setup.record(combined(change, hold_targets))
        yield joints_agree(light, mild, GEL_TOLERANCE, f"{what}: joints' change")
        on_it = plate.record(combined(change, hold_targets))
        yield joints_agree(on_it, on_plate, what=f"{what}: joints' change on a plate")
        # Without armature closings are up to 1.15 mm deep: discarded.
        yield from [no_unsound_accepted(light, what)] if what == "armature 0" else soundness(light, what=what)
    yield no_unsound_accepted(
        setup.record(combined(setting(dof_armature=0), mass(1e-4))), "armature 0 and masses x1e-4"
    )
    yield none_accepted(setup.record(mass(1e4)), "masses x1e4")


@CASES.case("time steps to 20 ms", STAGE, short=False)
def timesteps(subject) -> Iterator[Finding]:
    """Joint changes converge at first order from the default time step down, not yet from twice of it."""
    setup, patches = closing_setup(subject), surface_patches(load_collision(subject.folder))
    halved = (*TIMESTEPS[1:], TIMESTEPS[-1] / 2)
    at = {step: setup.record(simulation=GraspSimulation(HAND, patches, step)) for step in (0.01, 0.008, *halved)}
    for step, bound in ((0.01, GEL_TOLERANCE), (0.008, GEL_TOLERANCE), (0.004, JOINT_TOLERANCE)):
        yield joints_agree(at[step], at[TIMESTEPS[-1]], bound, f"{1e3 * step:g} ms: joints' change to 0.5 ms")
        yield from soundness(at[step], what=f"{1e3 * step:g} ms")
    yield converges([at[step] for step in halved], "time step")


@CASES.case("closing at 10 times the speed", STAGE)
def ten_times_faster(subject) -> Iterator[Finding]:
    """The resting place is the same."""
    setup, plate = closing_setup(subject), plate_setup()
    mild, sooner = setup.record(hold_targets), combined(faster_closing(10), hold_targets)
    yield joints_agree(setup.record(sooner), mild, GEL_TOLERANCE)
    yield joints_agree(plate.record(sooner), plate.record(hold_targets), what="joints' change on a plate")
    yield from soundness(setup.record(faster_closing(10)))


@CASES.case("starting in penetration", STAGE)
def starting_in_penetration(subject) -> Iterator[Finding]:
    """A plate inside an open finger's pad: the grasper refuses the pose, and contact pushes the pad out."""
    start = HAND.open_joint_positions
    for depth in (1e-4, 1e-3):
        setup = shapes.shape_setup(shapes.placed_at_pad(shapes.plate(width=0.02), start, depth), start)
        setup.grasper.simulation.place(np.eye(4), start)
        what = f"{1e3 * depth:g} mm deep"
        yield equal(f"{what}: pose is refused", setup.grasper.simulation.in_contact(), True)
        pushed = setup.record(hold_targets)[0]
        yield equal(f"{what}: engine's warnings", pushed.warnings, 0)
        yield at_most(f"{what}: depth at the end", 1e3 * pushed.depth, 1e3 * MAX_PENETRATION, "mm")


@CASES.case("faces, edges, vertices and grooves against the pad", STAGE, short=False)
def against_the_pad(subject) -> Iterator[Finding]:
    """Shapes in the way of the middle finger, at the pad's middle and rim.

    In a groove of half angle a, a tip that penetrates the walls by d moves on by d / sin a.
    """
    rim, narrow = (shapes.PAD_HALF_EXTENTS[0], 0), np.radians(15)
    met = {
        "plate": (shapes.plate(), (0, 0), 1.0),
        "edge": (shapes.edge(), (0, 0), 1.0),
        "edge on the rim": (shapes.edge(), rim, 1.0),
        "vertex": (shapes.vertex(), (0, 0), 1.0),
        "groove of 15 degrees": (shapes.groove(narrow, 0.005), (0, 0), np.sin(narrow)),
    }
    for name, (shape, at, sine) in met.items():
        mesh = shapes.placed_at_pad(shape, shapes.bent_finger(), at=at)
        setup, patches = shapes.shape_setup(mesh), surface_patches(mesh)
        simulations = [GraspSimulation(HAND, patches, step) for step in TIMESTEPS[1:4]]
        ends = [setup.record(hold_targets, simulation=simulation) for simulation in simulations]
        yield from soundness(ends[0], what=name)
        yield joints_agree(ends[0], ends[-1], JOINT_TOLERANCE / sine, f"{name}: joints' change to 1 ms")
        yield no_unsound_accepted(setup.record(combined(gains(100), hold_targets)), f"{name}, gains x100")
