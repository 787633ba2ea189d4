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

import copy
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import mujoco
import numpy as np

from palpate.grasp.closing import DURATION, RAMP, GraspSimulation
from palpate.grasp.grasp import BLOCKED, OUT_OF_RANGE, PENETRATING, UNSETTLED, UNSTABLE, Grasper
from palpate.grasp.patches import THICKNESS, surface_patches
from palpate.grasp.penetration import PenetrationCheck
from palpate.hand import MAX_PENETRATION, Hand, from_mjcf
from palpate.hand.model import ARMATURE, DAMPING, STIFFNESS, build_spec
from palpate.mesh import load_collision, load_visual
from palpate.touch import RayCaster
from studies.stability import shapes
from studies.stability.cases import REJECTED, Cases, Finding, at_least, at_most, equal, rejects
from studies.stability.closings import (
    CLOSED,
    GEL_TOLERANCE,
    HAND,
    JOINT_TOLERANCE,
    ClosingSetup,
    RecordedClosing,
    closing_setup,
    deepest_penetration,
    hold_targets,
    joint_change,
    joints_agree,
    record,
    soundness,
)

CASES = Cases()
STAGE = "grasps"
TIMESTEPS = (0.008, 0.004, 0.002, 0.001, 0.0005)  # s
IMPOSSIBLE = """
<mujoco><worldbody><body name="palm">
  <inertial pos="0 0 0" {}/><joint range="0 1"/><geom size=".1"/>
</body></worldbody></mujoco>
"""
HALF_LINK_THICKNESS = 0.0098  # m, of the Allegro's links: up to this depth contact pushes a link back out
# The grasper's reasons to take no closing, but for those that touch nothing.
REFUSED = (UNSTABLE, UNSETTLED, OUT_OF_RANGE, PENETRATING)
Change = Callable[[GraspSimulation], None]


def setting(safe: bool = True, **values: Any) -> Change:
    """Set fields of the model; safe: keep the engine's `refsafe` on."""

    def edit(simulation: GraspSimulation) -> None:
        for name, value in values.items():
            getattr(simulation.model, name)[:] = value
        if not safe:
            simulation.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_REFSAFE

    return edit


def solref(first: float, second: float = 1.0, safe: bool = True) -> Change:
    """Set time constant (s) and damping ratio of contacts and joint limits."""
    return setting(safe, geom_solref=(first, second), jnt_solref=(first, second))


def solimp(*values: float) -> Change:
    """Set impedances of contacts and joint limits: at depth 0, at `width` (m), `width`, midpoint and power."""
    return setting(geom_solimp=values, jnt_solimp=values)


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


def armature(value: float) -> Change:
    """Set the armature of all hinges, kg m^2."""
    return setting(dof_armature=value)


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
    accepted = [each for each in recorded if each.outcome not in REFUSED]
    note = ", ".join(sorted({each.outcome for each in recorded}))
    finding = equal(f"{what}: closings taken", len(accepted), 0, note=note)
    return finding if accepted else finding._replace(verdict=REJECTED)


def no_unsound_accepted(recorded: Sequence[RecordedClosing], what: str) -> Finding:
    """Finding: the grasper accepts no closing with engine warnings or with more kinetic energy than servo work."""
    unsound = [each for each in recorded if each.outcome not in REFUSED and (each.warnings or each.energy_gain > 1)]
    note = ", ".join(each.outcome for each in recorded)
    return equal(f"{what}: unsound closings taken", len(unsound), 0, note=note)


def converges(ends: Sequence[Sequence[RecordedClosing]], what: str, order: int = 1) -> Finding:
    """Finding: joint changes shrink by 2^order with each halving of a parameter, within a factor of two overall.

    ends: the same closings at each value of the parameter. The median closing counts.
    """
    pairs = [zip(*two, strict=True) for two in zip(ends, ends[1:], strict=False)]
    middle = [float(np.median([joint_change(*pair) for pair in each])) for each in pairs]
    note = ", ".join(f"{each:.1e}" for each in middle) + " rad"
    bound = 2 * 0.5 ** (order * (len(middle) - 1))
    return at_most(f"{what}: last change over first", middle[-1] / middle[0], bound, note=note)


def depth_while_closing(setup: ClosingSetup, recorded: Sequence[RecordedClosing], what: str) -> Finding:
    """Finding: during the closing no link is deeper than half its thickness; contact would push it through."""
    depth = deepest_penetration(setup.grasper, setup.closings[0], recorded[0])
    return at_most(f"{what}: depth on the way", 1e3 * depth, 1e3 * HALF_LINK_THICKNESS, "mm", "the first closing")


@CASES.case("solref at the time step and below", STAGE)
def solref_at_the_time_step(subject) -> Iterator[Finding]:
    """The engine's `refsafe` raises any time constant below two steps to two steps, Palpate's default."""
    setup = closing_setup(subject)
    mild, step = setup.record(), setup.grasper.simulation.model.opt.timestep
    for steps in (1, 0.5, 0.1, 1e-3):
        hard = setup.record(solref(steps * step))
        yield equal(f"joints' change at {steps:g} steps", max(map(joint_change, hard, mild)), 0.0, "rad")
    yield from soundness(mild)


@CASES.case("refsafe off", STAGE)
def refsafe_off(subject) -> Iterator[Finding]:
    """Without `refsafe` contact is stable down to a time constant of about a step; below, it creates energy."""
    setup = closing_setup(subject)
    step = setup.grasper.simulation.model.opt.timestep
    yield from soundness(setup.record(solref(2 * step, safe=False)), what="solref 2 steps")
    for steps in (0.5, 0.25):
        yield no_unsound_accepted(setup.record(solref(steps * step, safe=False)), f"solref {steps:g} steps")
    for steps in (0.1, 1e-3):
        yield none_accepted(setup.record(solref(steps * step, safe=False)), f"solref {steps:g} steps")


@CASES.case("what refsafe doesn't guard", STAGE)
def refsafe_missing(subject) -> Iterator[Finding]:
    """Stiffness itself (a negative solref), and the damping ratio, whose square divides the stiffness."""
    setup = closing_setup(subject)
    step = setup.grasper.simulation.model.opt.timestep
    yield from soundness(setup.record(solref(-1e4, -2e2)), what="stiffness 1e4 /s^2")
    yield none_accepted(setup.record(solref(-1e8, -2e4)), "stiffness 1e8 /s^2")
    yield no_unsound_accepted(setup.record(solref(2 * step, 100)), "damping ratio 100")
    yield none_accepted(setup.record(solref(2 * step, 0.01)), "damping ratio 0.01")


@CASES.case("solref to zero, one time step", STAGE)
def solref_converges(subject) -> Iterator[Finding]:
    """Time constants of 16 to 2 ms at a time step of 1 ms: depth goes as their square, and joints with it."""
    for name, shape in (("plate", shapes.plate()), ("vertex", shapes.vertex())):
        mesh = shapes.placed_at_pad(shape, shapes.bent_finger())
        setup = shapes.shape_setup(mesh)
        simulation = GraspSimulation(HAND, surface_patches(mesh), 0.001)
        ends = [setup.record(combined(solref(0.001 * 2**k), hold_targets), simulation=simulation) for k in (4, 3, 2, 1)]
        yield converges(ends, name, order=2)
        yield joints_agree(ends[-1], setup.record(hold_targets), what=f"{name}: joints' change to the default")
        yield from soundness(ends[-1], what=name)


@CASES.case("solimp extremes", STAGE)
def solimp_extremes(subject) -> Iterator[Finding]:
    """Contacts that become hard at once, late, or never."""
    setup = closing_setup(subject)
    mild = setup.record()
    hard = {
        "impedance 1": (1, 1, 0.0005, 0.5, 2),
        "width 0": (0.95, 0.99, 0, 0.5, 2),
        "width 1 nm": (0.1, 0.99, 1e-9, 0.5, 2),
        "midpoint 0": (0.1, 0.99, 0.0005, 0, 2),
        "midpoint 1, power 50": (0.1, 0.99, 0.0005, 1, 50),
        "power 1000": (0.1, 0.99, 0.0005, 0.5, 1000),
    }
    recorded = {name: setup.record(solimp(*values), name) for name, values in hard.items()}
    yield from soundness([each for of in recorded.values() for each in of])
    for name, of in recorded.items():
        yield joints_agree(of, mild, what=f"{name}: joints' change")
    yield no_unsound_accepted(setup.record(solimp(0, 0, 0.001, 0.5, 2)), "impedance 0")
    yield no_unsound_accepted(setup.record(solimp(0.1, 0.99, 1, 0.5, 2)), "width 1 m")


@CASES.case("servos' gains x100", STAGE)
def gains_times_100(subject) -> Iterator[Finding]:
    """The torque limit of 0.5 N m bounds the force. Final poses differ where an object stops the fingers."""
    setup = closing_setup(subject)
    free = setup.record(gains(100), "x100")
    yield from soundness(free, what="torque limited")
    yield no_unsound_accepted(setup.record(gains(100, torque=100)), "torque x100")
    yield no_unsound_accepted(setup.record(gains(1e4, torque=1e4)), "gains and torque x1e4")
    distant_ball = shapes.shape_setup(shapes.distant_ball())
    ends = distant_ball.record(combined(gains(100), hold_targets)), distant_ball.record(hold_targets)
    yield joints_agree(*ends, what="nothing in the way: joints' change")


@CASES.case("servos' gains x100 at 10 ms", STAGE, short=False)
def gains_at_10_ms(subject) -> Iterator[Finding]:
    setup = closing_setup(subject)
    simulation = GraspSimulation(HAND, surface_patches(load_collision(subject.folder)), 0.01, stiffness=100 * STIFFNESS)
    yield none_accepted(setup.record(simulation=simulation), "torque limited")


@CASES.case("masses 1e-4 to 1e4", STAGE)
def mass_ratios(subject) -> Iterator[Finding]:
    """All links or the tips alone: light hands rest where the default does, heavy ones don't come to rest."""
    setup, plate = closing_setup(subject), plate_setup()
    mild, on_plate = setup.record(hold_targets), plate.record(hold_targets)
    for name, links in (("all links", ""), ("tips", "_tip")):
        for factor in (1e-4, 1e-2):
            lighter, what = combined(mass(factor, links), hold_targets), f"{name} x{factor:g}"
            light = setup.record(lighter)
            yield joints_agree(light, mild, GEL_TOLERANCE, f"{what}: joints' change")
            yield joints_agree(plate.record(lighter), on_plate, what=f"{what}: joints' change on a plate")
            yield from soundness(light, what=what)
        yield none_accepted(setup.record(mass(1e4, links)), f"{name} x1e4")


@CASES.case("armature to 0", STAGE)
def armature_to_zero(subject) -> Iterator[Finding]:
    """The servos' damping stays; only the links' own inertia remains, 1e-5 kg m^2 at a finger's base."""
    setup, plate = closing_setup(subject), plate_setup()
    mild, on_plate = setup.record(hold_targets), plate.record(hold_targets)
    for share in (0.1, 0.01, 0):
        lighter = combined(armature(share * ARMATURE), hold_targets)
        less = setup.record(lighter)
        yield joints_agree(less, mild, GEL_TOLERANCE, f"x{share:g}: joints' change")
        yield joints_agree(plate.record(lighter), on_plate, what=f"x{share:g}: joints' change on a plate")
        yield no_unsound_accepted(less, f"x{share:g}")
    light = setup.record(combined(armature(0), mass(1e-4)))
    yield no_unsound_accepted(light, "and masses x1e-4")


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
    yield depth_while_closing(setup, at[0.004], "4 ms")


@CASES.case("closing at 10 times the speed", STAGE)
def ten_times_faster(subject) -> Iterator[Finding]:
    """Also how much holding longer changes: in theory the remainder of the servos' lag behind their ramp."""
    setup, plate = closing_setup(subject), plate_setup()
    mild, sooner = setup.record(hold_targets), combined(faster_closing(10), hold_targets)
    yield joints_agree(setup.record(sooner), mild, GEL_TOLERANCE)
    yield joints_agree(plate.record(sooner), plate.record(hold_targets), what="joints' change on a plate")
    fast = setup.record(faster_closing(10))
    yield from soundness(fast)
    yield depth_while_closing(setup, fast, "10 times")
    swept = [np.abs(each.targets - HAND.open_joint_positions).max() for each in setup.closings]
    kept = [joint_change(*pair) for pair in zip(setup.record(), mild, strict=True)]
    lag = (2 * np.sqrt(STIFFNESS * ARMATURE) + DAMPING) / STIFFNESS  # s
    left = np.exp(-(1 - RAMP) * DURATION / lag) * lag * np.array(swept) / (RAMP * DURATION)
    yield at_most("at the usual speed: way left over the lag's", float(np.median(kept / left)), 1)


@CASES.case("starting in contact and in penetration", STAGE)
def starting_in_penetration(subject) -> Iterator[Finding]:
    """A plate just in front of an open finger's pad, or some depth inside it. The grasper refuses such poses.

    The closing starts there all the same. Contact pushes the pad at most one depth per time constant, and adds
    no more energy than that speed has. Deeper than the patches' thickness, contact can't push it out.
    """
    start = HAND.open_joint_positions
    for depth in (-1e-6, 1e-6, 1e-4, 1e-3, 5e-3):
        mesh = shapes.placed_at_pad(shapes.plate(width=0.02), start, depth)
        setup = shapes.shape_setup(mesh, start)
        simulation = setup.grasper.simulation
        simulation.place(np.eye(4), start)
        yield equal(f"{1e3 * depth:g} mm deep: pose is refused", simulation.in_contact(), depth > 0)
        if depth < 1e-4:
            continue
        pushed = setup.record(hold_targets)[0]
        speed = depth / (2 * simulation.model.opt.timestep)
        energy = 0.5 * shapes.mass_at_pad(simulation) * speed**2
        yield equal(f"{1e3 * depth:g} mm deep: engine's warnings", pushed.warnings, 0)
        over = float((pushed.kinetic - pushed.work).max() / energy)
        yield at_most(f"{1e3 * depth:g} mm deep: kinetic energy over a push's", over, 1)
        if depth <= THICKNESS:
            yield at_most(f"{1e3 * depth:g} mm deep: depth at the end", 1e3 * pushed.depth, 1e3 * MAX_PENETRATION, "mm")
        else:
            yield none_accepted([pushed], f"{1e3 * depth:g} mm deep, through the patches")
    yield from palm_in_object(subject)


def palm_in_object(subject) -> Iterator[Finding]:
    """The engine never collides palm and object, which are both fixed: the penetration check does."""
    setup = closing_setup(subject)
    deep = np.eye(4)
    deep[:3, 3] = setup.grasper.surface.points[0] - HAND.palm_anchor[:3, 3]
    links = HAND.forward(deep, HAND.open_joint_positions)
    yield at_least("palm in the surface: depth seen", 1e3 * setup.grasper.check.in_object(links), 1, "mm")
    narrow_sheets, points = shapes.narrow_sheets()
    result = Grasper(narrow_sheets, narrow_sheets, points, HAND).attempt(np.random.default_rng(0))
    yield equal("gaps that no palm fits in", result if isinstance(result, str) else CLOSED, BLOCKED)


@CASES.case("a finger wedged between two surfaces", STAGE)
def wedged(subject) -> Iterator[Finding]:
    """A groove that narrows towards the target; a slot narrower than the tip, which starts inside both walls.

    In a groove of half angle a, a tip that penetrates the walls by d moves on by d / sin a.
    """
    for degrees, gap in ((15, 0.005), (5, 0.011)):
        mesh = shapes.placed_at_pad(shapes.groove(np.radians(degrees), gap), shapes.bent_finger(), 0)
        setup = shapes.shape_setup(mesh)
        mild, stiff = setup.record(hold_targets), setup.record(combined(solref(1e-6), gains(100), hold_targets))
        yield from soundness([*mild, *stiff], what=f"{degrees} degrees")
        finer = setup.record(hold_targets, simulation=GraspSimulation(HAND, surface_patches(mesh), 0.001))
        bound = JOINT_TOLERANCE / np.sin(np.radians(degrees))
        yield joints_agree(mild, finer, bound, f"{degrees} degrees: joints' change to 1 ms")
    for narrower in (0.0004, 0.008):
        half, what = shapes.FINGERTIP_WIDTH / 2 - narrower / 2, f"slot {1e3 * narrower:g} mm too narrow"
        setup = shapes.shape_setup(shapes.placed_at_pad(shapes.groove(0, half), shapes.bent_finger(), 0.01))
        simulation, bent_finger = setup.grasper.simulation, shapes.bent_finger()
        simulation.place(np.eye(4), bent_finger)
        yield equal(f"{what}: pose is refused", simulation.in_contact(), True)
        stuck = record(setup.grasper, simulation, setup.closings[0], start=bent_finger)
        yield equal(f"{what}: engine's warnings", stuck.warnings, 0)
        if narrower / 2 <= THICKNESS:
            yield at_most(f"{what}: moved by", float(np.abs(stuck.joints - bent_finger).max()), JOINT_TOLERANCE, "rad")
            yield at_most(f"{what}: depth", 1e3 * stuck.depth, 1e3 * MAX_PENETRATION, "mm")


@CASES.case("faces, edges and vertices against the pad", STAGE, short=False)
def edges_and_vertices(subject) -> Iterator[Finding]:
    """Against the pad's middle, rim and corner; at the corner it is chance to which side the tip slips off."""
    rim, corner = (shapes.PAD_HALF_EXTENTS[0], 0), shapes.PAD_HALF_EXTENTS
    met = {
        "plate": (shapes.plate(), (0, 0)),
        "ball": (shapes.ball(), (0, 0)),
        "edge along": (shapes.edge(along=True), (0, 0)),
        "edge across": (shapes.edge(along=False), (0, 0)),
        "vertex": (shapes.vertex(), (0, 0)),
        "edge on the rim": (shapes.edge(along=True), rim),
        "vertex on the rim": (shapes.vertex(), rim),
        "vertex on the corner": (shapes.vertex(), corner),
    }
    for name, (shape, at) in met.items():
        mesh = shapes.placed_at_pad(shape, shapes.bent_finger(), at=at)
        setup, patches = shapes.shape_setup(mesh), surface_patches(mesh)
        simulations = [GraspSimulation(HAND, patches, step) for step in TIMESTEPS[:4]]
        ends = [setup.record(hold_targets, simulation=each) for each in simulations]
        yield from soundness(ends[1], what=name)
        if at != corner:
            yield joints_agree(ends[1], ends[2], what=f"{name}: joints' change to 2 ms")
            yield converges(ends, name, order=2)
        yield no_unsound_accepted(setup.record(combined(gains(100), hold_targets)), f"{name}, gains x100")


@CASES.case("a hand of another size", STAGE, short=False)
def sizes_of_hands(subject) -> Iterator[Finding]:
    """At equal density, a hand of s times the size has links of s^5 times the inertia."""
    setup, visual = closing_setup(subject), load_visual(subject.folder)
    patches = surface_patches(load_collision(subject.folder))
    mild = setup.record(hold_targets)
    for size in (0.1, 2, 4):
        hand = scaled_hand(HAND, size)
        grasper = copy.copy(setup.grasper)
        grasper.hand, mesh = hand, visual.copy().apply_scale(size)
        grasper.check, grasper.caster = PenetrationCheck(hand, mesh), RayCaster(mesh)
        grasper.simulation = GraspSimulation(hand, [size * each for each in patches])
        closings = [each._replace(pose=scaled_position(each.pose, size)) for each in setup.closings]
        ends = ClosingSetup(grasper, closings).record(hold_targets)
        yield joints_agree(ends, mild, GEL_TOLERANCE, f"x{size:g}: joints' change")
        yield from soundness(ends, what=f"x{size:g}")


@CASES.case("a hand's file with extreme values", STAGE)
def extreme_files(subject) -> Iterator[Finding]:
    """Gains, armature, damping and masses of a file have no effect; impossible values raise a clear error."""
    setup, patches = closing_setup(subject), surface_patches(load_collision(subject.folder))
    with TemporaryDirectory() as folder:
        ends = []
        files = {"mild": (1.0, 5e-4, 1e3), "stiff": (1e8, 0.0, 1e9), "limp": (1e-8, 1e8, 1e-3)}
        for name, values in files.items():
            hand = written_and_read(Path(folder) / f"{name}.xml", *values)
            simulation = GraspSimulation(hand, patches)
            simulation.place(setup.closings[0].pose, hand.open_joint_positions)
            ends.append(simulation.close(setup.closings[0].targets).joint_positions)
        for name, joints in zip(("stiff", "limp"), ends[1:], strict=True):
            yield equal(f"{name}: joints' change", float(np.abs(joints - ends[0]).max()), 0.0, "rad")
        for name, values in {"inertia": 'mass="1" diaginertia="1 1 9"', "mass": 'mass="-1"'}.items():
            file = Path(folder) / f"impossible_{name}.xml"
            file.write_text(IMPOSSIBLE.format(values))
            found = rejects(name, partial(from_mjcf, file, {"sensors": [{"site": "gel"}]}), ValueError, file.name)
            yield found._replace(note=found.note.replace(f"{folder}/", ""))
    reason = "from end to end, not 0.01 to 1 m: give all lengths in metres"
    for size in (10, 1000, 0.001):
        yield rejects(f"lengths x{size:g}", partial(scaled_hand, HAND, size), ValueError, reason)
    crossed, far = replace(HAND, open_joint_positions=shapes.crossed_fingers()), shapes.distant_ball()
    grasper = partial(Grasper, far, far, far.triangles_center, crossed)
    yield rejects("open hand in itself", grasper, ValueError, "deep in each other")


def scaled_hand(hand: Hand, size: float) -> Hand:
    """The hand with all lengths scaled by `size`."""
    names = ("link_position", "geom_size", "geom_position", "sensor_position")
    lengths = {name: size * getattr(hand, name) for name in names}
    return replace(hand, palm_anchor=scaled_position(hand.palm_anchor, size), **lengths)


def scaled_position(pose: np.ndarray, size: float) -> np.ndarray:
    """A pose (4, 4) with its translation scaled by `size`."""
    pose = pose.copy()
    pose[:3, 3] *= size
    return pose


def written_and_read(path: Path, stiffness: float, armature: float, density: float) -> Hand:
    """Write the hand as a model file with this servo gain, armature (kg m^2) and density (kg/m^3); read it back."""
    spec = build_spec(HAND)
    for actuator in spec.actuators:
        actuator.set_to_position(kp=stiffness)
    for joint in spec.joints:
        joint.armature = armature
    for geom in spec.geoms:
        geom.density = density
    spec.compile()
    path.write_text(spec.to_xml())
    sensors = [
        {"body": HAND.link_names[link], "position": place.tolist()}
        for link, place in zip(HAND.sensor_link, HAND.sensor_position, strict=True)
    ]
    return from_mjcf(path, {"sensors": sensors, "open": HAND.open_joint_positions.tolist()}, gel_face=0.0)
