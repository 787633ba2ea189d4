"""Stiff and extreme contact in grasps: what the engine, the grasper and the checks behind them make of it.

Where nothing else is said, closings are those of an object of the run: three palm poses clear of it, all
fingers closing. Bounds: `MAX_PENETRATION`, 1 mm, is what a grasp may be deep by config/config.yaml; `JOINT` is the
angle by which 1 mm is seen at the end of a finger; `GEL` that of a gel's 3.2 mm, where fingers that get there
another way may rest elsewhere; kinetic energy is compared with the servos' work, of which alone it can come.
Depths are `palpate.grasp.penetration`'s, of true surfaces, and not the engine's own.
"""

import copy
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np

from palpate.grasp.closing import DURATION, RAMP, GraspSimulation
from palpate.grasp.grasp import BLOCKED, PENETRATING, UNSETTLED, UNSTABLE, Grasper
from palpate.grasp.patches import THICKNESS, surface_patches
from palpate.grasp.penetration import PenetrationCheck
from palpate.hand import MAX_PENETRATION, Hand, from_mjcf
from palpate.hand.model import ARMATURE, DAMPING, STIFFNESS, build_spec
from palpate.mesh import load_collision, load_visual
from palpate.touch import RayCaster
from studies.stability import shapes
from studies.stability.cases import REJECTED, Cases, Finding, at_least, at_most, equal, rejects
from studies.stability.watched import (
    GEL,
    HAND,
    JOINT,
    TOUCHED,
    Setting,
    Watched,
    agree,
    change,
    deepest,
    held,
    setting,
    sound,
    watch,
)

CASES = Cases()
STAGE = "grasps"
TIMESTEPS = (0.008, 0.004, 0.002, 0.001, 0.0005)  # s
IMPOSSIBLE = """
<mujoco><worldbody><body name="palm">
  <inertial pos="0 0 0" {}/><joint range="0 1"/><geom size=".1"/>
</body></worldbody></mujoco>
"""
HALF_A_LINK = 0.0098  # m, of the thickness of the Allegro's links: at less, contact pushes them back
Change = Callable[[GraspSimulation], None]


def solref(first: float, second: float = 1.0, safe: bool = True) -> Change:
    """Contacts and limits of a time constant (s) and damping ratio; safe: by the engine's `refsafe`."""

    def edit(simulation: GraspSimulation) -> None:
        model = simulation.model
        model.geom_solref[:] = model.jnt_solref[:] = first, second
        if not safe:
            model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_REFSAFE

    return edit


def solimp(*values: float) -> Change:
    """Contacts and limits of impedances at 0 and at a width (m), that width, midpoint and power."""

    def edit(simulation: GraspSimulation) -> None:
        simulation.model.geom_solimp[:] = simulation.model.jnt_solimp[:] = values

    return edit


def gains(factor: float, torque: float = 1.0) -> Change:
    """Servos of other gain, critically damped all the same, and of another largest torque."""

    def edit(simulation: GraspSimulation) -> None:
        model = simulation.model
        model.actuator_gainprm[:, 0] *= factor
        model.actuator_biasprm[:, 1] *= factor
        model.actuator_biasprm[:, 2] *= np.sqrt(factor)
        model.actuator_forcerange[:] *= torque

    return edit


def mass(factor: float, links: str = "") -> Change:
    """Mass and inertia of the links with this in their names, which `palpate.hand.model` would not allow."""

    def edit(simulation: GraspSimulation) -> None:
        model = simulation.model
        chosen = [body for body in range(model.nbody) if links in model.body(body).name]
        model.body_mass[chosen] *= factor
        model.body_inertia[chosen] *= factor
        mujoco.mj_setConst(model, mujoco.MjData(model))

    return edit


def armature(value: float) -> Change:
    """Hinges of this armature in kg m^2."""

    def edit(simulation: GraspSimulation) -> None:
        simulation.model.dof_armature[:] = value

    return edit


def faster(factor: float) -> Change:
    """Targets that arrive that much sooner, and are held as much longer."""

    def edit(simulation: GraspSimulation) -> None:
        simulation.ramp = np.minimum(1.0, factor * simulation.ramp)

    return edit


def all_of(*changes: Change) -> Change:
    """Several changes, one after the other."""

    def edit(simulation: GraspSimulation) -> None:
        for each in changes:
            each(simulation)

    return edit


def refused(watched: Sequence[Watched], what: str) -> Finding:
    """That the grasper takes no closing."""
    reasons = (UNSTABLE, UNSETTLED, PENETRATING)
    taken = [each for each in watched if each.outcome not in reasons]
    note = ", ".join(sorted({each.outcome for each in watched}))
    finding = equal(f"{what}: closings taken", len(taken), 0, note=note)
    return finding if taken else finding._replace(verdict=REJECTED)


def none_unsound(watched: Sequence[Watched], what: str) -> Finding:
    """That the grasper takes no closing of which the engine warned or whose energy came from nowhere."""
    reasons = (UNSTABLE, UNSETTLED, PENETRATING)
    unsound = [each for each in watched if each.outcome not in reasons and (each.warnings or each.gain > 1)]
    note = ", ".join(each.outcome for each in watched)
    return equal(f"{what}: unsound closings taken", len(unsound), 0, note=note)


def converges(ends: Sequence[Sequence[Watched]], what: str, order: int = 1) -> Finding:
    """That the joints' change shrinks with each halving by 2^order, on the whole; twice of that is allowed.

    ends: the same closings at each value of the knob. The median closing counts.
    """
    pairs = [zip(*two, strict=True) for two in zip(ends, ends[1:], strict=False)]
    middle = [float(np.median([change(*pair) for pair in each])) for each in pairs]
    note = ", ".join(f"{each:.1e}" for each in middle) + " rad"
    bound = 2 * 0.5 ** (order * (len(middle) - 1))
    return at_most(f"{what}: last change over first", middle[-1] / middle[0], bound, note=note)


def on_the_way(on: Setting, watched: Sequence[Watched], what: str) -> Finding:
    """That no link is half in the object while it closes, from where the contact would push it through."""
    depth = deepest(on.grasper, on.closings[0], watched[0])
    return at_most(f"{what}: depth on the way", 1e3 * depth, 1e3 * HALF_A_LINK, "mm", "the first closing")


@CASES.case("solref at the time step and below", STAGE)
def solref_at_the_time_step(subject) -> Iterator[Finding]:
    """The engine's `refsafe` makes any time constant below two steps two steps, which is Palpate's own."""
    on = setting(subject)
    mild, step = on.watch(), on.grasper.simulation.model.opt.timestep
    for steps in (1, 0.5, 0.1, 1e-3):
        hard = on.watch(solref(steps * step))
        yield equal(f"joints' change at {steps:g} steps", max(map(change, hard, mild)), 0.0, "rad")
    yield from sound(mild)


@CASES.case("refsafe off", STAGE)
def refsafe_off(subject) -> Iterator[Finding]:
    """Without it contact is explicit: stable to about a time step, then it makes energy."""
    on = setting(subject)
    step = on.grasper.simulation.model.opt.timestep
    yield from sound(on.watch(solref(2 * step, safe=False)), what="solref 2 steps")
    for steps in (0.5, 0.25):
        yield none_unsound(on.watch(solref(steps * step, safe=False)), f"solref {steps:g} steps")
    for steps in (0.1, 1e-3):
        yield refused(on.watch(solref(steps * step, safe=False)), f"solref {steps:g} steps")


@CASES.case("what refsafe doesn't guard", STAGE)
def refsafe_missing(subject) -> Iterator[Finding]:
    """Stiffness itself (a negative solref), and the damping ratio, whose square divides the stiffness."""
    on = setting(subject)
    step = on.grasper.simulation.model.opt.timestep
    yield from sound(on.watch(solref(-1e4, -2e2)), what="stiffness 1e4 /s^2")
    yield refused(on.watch(solref(-1e8, -2e4)), "stiffness 1e8 /s^2")
    yield none_unsound(on.watch(solref(2 * step, 100)), "damping ratio 100")
    yield refused(on.watch(solref(2 * step, 0.01)), "damping ratio 0.01")


@CASES.case("solref to zero, one time step", STAGE)
def solref_converges(subject) -> Iterator[Finding]:
    """Time constants of 16 to 2 ms at a time step of 1 ms: depth goes as their square, and joints with it."""
    for name, shape in (("plate", shapes.plate()), ("vertex", shapes.vertex())):
        mesh = shapes.facing(shape, shapes.bent())
        on = shapes.alone(mesh)
        simulation = GraspSimulation(HAND, surface_patches(mesh), 0.001)
        ends = [on.watch(all_of(solref(0.001 * 2**k), held), simulation=simulation) for k in (4, 3, 2, 1)]
        yield converges(ends, name, order=2)
        yield agree(ends[-1], on.watch(held), what=f"{name}: joints' change to the default")
        yield from sound(ends[-1], what=name)


@CASES.case("solimp extremes", STAGE)
def solimp_extremes(subject) -> Iterator[Finding]:
    """Contacts that are hard at once, late, or never."""
    on = setting(subject)
    mild = on.watch()
    hard = {
        "impedance 1": (1, 1, 0.0005, 0.5, 2),
        "width 0": (0.95, 0.99, 0, 0.5, 2),
        "width 1 nm": (0.1, 0.99, 1e-9, 0.5, 2),
        "midpoint 0": (0.1, 0.99, 0.0005, 0, 2),
        "midpoint 1, power 50": (0.1, 0.99, 0.0005, 1, 50),
        "power 1000": (0.1, 0.99, 0.0005, 0.5, 1000),
    }
    watched = {name: on.watch(solimp(*values), name) for name, values in hard.items()}
    yield from sound([each for of in watched.values() for each in of])
    for name, of in watched.items():
        yield agree(of, mild, what=f"{name}: joints' change")
    yield none_unsound(on.watch(solimp(0, 0, 0.001, 0.5, 2)), "impedance 0")
    yield none_unsound(on.watch(solimp(0.1, 0.99, 1, 0.5, 2)), "width 1 m")


@CASES.case("servos' gains x100", STAGE)
def gains_times_100(subject) -> Iterator[Finding]:
    """At the torque limit of 0.5 N m they press, no harder; where fingers are held off, the ends differ."""
    on = setting(subject)
    free = on.watch(gains(100), "x100")
    yield from sound(free, what="torque limited")
    yield none_unsound(on.watch(gains(100, torque=100)), "torque x100")
    yield none_unsound(on.watch(gains(1e4, torque=1e4)), "gains and torque x1e4")
    far = shapes.alone(shapes.far())
    ends = far.watch(all_of(gains(100), held)), far.watch(held)
    yield agree(*ends, what="nothing in the way: joints' change")


@CASES.case("servos' gains x100 at 10 ms", STAGE, short=False)
def gains_at_10_ms(subject) -> Iterator[Finding]:
    on = setting(subject)
    simulation = GraspSimulation(HAND, surface_patches(load_collision(subject.folder)), 0.01, stiffness=100 * STIFFNESS)
    yield refused(on.watch(simulation=simulation), "torque limited")


@CASES.case("masses 1e-4 to 1e4", STAGE)
def mass_ratios(subject) -> Iterator[Finding]:
    """Of all links, or the tips alone: light hands rest where the mild one does, heavy ones don't rest."""
    on, plate = setting(subject), shapes.alone(shapes.facing(shapes.plate(), shapes.bent()))
    mild, on_plate = on.watch(held), plate.watch(held)
    for name, links in (("all links", ""), ("tips", "_tip")):
        for factor in (1e-4, 1e-2):
            lighter, what = all_of(mass(factor, links), held), f"{name} x{factor:g}"
            light = on.watch(lighter)
            yield agree(light, mild, GEL, f"{what}: joints' change")
            yield agree(plate.watch(lighter), on_plate, what=f"{what}: joints' change on a plate")
            yield from sound(light, what=what)
        yield refused(on.watch(mass(1e4, links)), f"{name} x1e4")


@CASES.case("armature to 0", STAGE)
def armature_to_zero(subject) -> Iterator[Finding]:
    """The servos' damping stays; of inertia the links' own is left, 1e-5 kg m^2 at a finger's base."""
    on, plate = setting(subject), shapes.alone(shapes.facing(shapes.plate(), shapes.bent()))
    mild, on_plate = on.watch(held), plate.watch(held)
    for share in (0.1, 0.01, 0):
        lighter = all_of(armature(share * ARMATURE), held)
        less = on.watch(lighter)
        yield agree(less, mild, GEL, f"x{share:g}: joints' change")
        yield agree(plate.watch(lighter), on_plate, what=f"x{share:g}: joints' change on a plate")
        yield none_unsound(less, f"x{share:g}")
    light = on.watch(all_of(armature(0), mass(1e-4)))
    yield none_unsound(light, "and masses x1e-4")


@CASES.case("time steps to 20 ms", STAGE, short=False)
def timesteps(subject) -> Iterator[Finding]:
    """Joints' changes are of first order from the default's step on; at twice of it they are not yet."""
    on, patches = setting(subject), surface_patches(load_collision(subject.folder))
    halved = (*TIMESTEPS[1:], TIMESTEPS[-1] / 2)
    at = {step: on.watch(simulation=GraspSimulation(HAND, patches, step)) for step in (0.01, 0.008, *halved)}
    for step, bound in ((0.01, GEL), (0.008, GEL), (0.004, JOINT)):
        yield agree(at[step], at[TIMESTEPS[-1]], bound, f"{1e3 * step:g} ms: joints' change to 0.5 ms")
        yield from sound(at[step], what=f"{1e3 * step:g} ms")
    yield converges([at[step] for step in halved], "time step")
    yield on_the_way(on, at[0.004], "4 ms")


@CASES.case("closing at 10 times the speed", STAGE)
def ten_times_faster(subject) -> Iterator[Finding]:
    """Also what holding longer would change: by theory what is left of the servos' lag behind their ramp."""
    on, plate = setting(subject), shapes.alone(shapes.facing(shapes.plate(), shapes.bent()))
    mild, sooner = on.watch(held), all_of(faster(10), held)
    yield agree(on.watch(sooner), mild, GEL)
    yield agree(plate.watch(sooner), plate.watch(held), what="joints' change on a plate")
    fast = on.watch(faster(10))
    yield from sound(fast)
    yield on_the_way(on, fast, "10 times")
    swept = [np.abs(each.targets - HAND.open_joint_positions).max() for each in on.closings]
    kept = [change(*pair) for pair in zip(on.watch(), mild, strict=True)]
    lag = (2 * np.sqrt(STIFFNESS * ARMATURE) + DAMPING) / STIFFNESS  # s
    left = np.exp(-(1 - RAMP) * DURATION / lag) * lag * np.array(swept) / (RAMP * DURATION)
    yield at_most("at the usual speed: way left over the lag's", float(np.median(kept / left)), 1)


@CASES.case("starting in contact and in penetration", STAGE)
def starting_in_penetration(subject) -> Iterator[Finding]:
    """A plate in front of one open finger's pad, and this deep in it. Such poses are not free for a grasp.

    Closed from there all the same: the contact pushes at no more than the depth in a time constant, and gives
    no more energy than a push of this speed. Deeper than the patches are thick, it doesn't find the way out.
    """
    start = HAND.open_joint_positions
    for depth in (-1e-6, 1e-6, 1e-4, 1e-3, 5e-3):
        mesh = shapes.facing(shapes.plate(width=0.02), start, depth)
        on = shapes.alone(mesh, start)
        simulation = on.grasper.simulation
        simulation.place(np.eye(4), start)
        yield equal(f"{1e3 * depth:g} mm deep: pose is refused", simulation.in_contact(), depth > 0)
        if depth < 1e-4:
            continue
        pushed = on.watch(held)[0]
        speed = depth / (2 * simulation.model.opt.timestep)
        energy = 0.5 * shapes.mass_at_pad(simulation) * speed**2
        yield equal(f"{1e3 * depth:g} mm deep: engine's warnings", pushed.warnings, 0)
        over = float((pushed.kinetic - pushed.work).max() / energy)
        yield at_most(f"{1e3 * depth:g} mm deep: kinetic energy over a push's", over, 1)
        if depth <= THICKNESS:
            yield at_most(f"{1e3 * depth:g} mm deep: depth at the end", 1e3 * pushed.depth, 1e3 * MAX_PENETRATION, "mm")
        else:
            yield refused([pushed], f"{1e3 * depth:g} mm deep, through the patches")
    yield from palm_in_the_object(subject)


def palm_in_the_object(subject) -> Iterator[Finding]:
    """The engine never collides the palm with the object, for neither can move: the check does."""
    on = setting(subject)
    deep = np.eye(4)
    deep[:3, 3] = on.grasper.surface.points[0] - HAND.palm_anchor[:3, 3]
    links = HAND.forward(deep, HAND.open_joint_positions)
    yield at_least("palm in the surface: depth seen", 1e3 * on.grasper.check.in_object(links), 1, "mm")
    louvre, points = shapes.louvre()
    result = Grasper(louvre, louvre, points, HAND).attempt(np.random.default_rng(0))
    yield equal("gaps that no palm fits in", result if isinstance(result, str) else TOUCHED, BLOCKED)


@CASES.case("a finger wedged between two surfaces", STAGE)
def wedged(subject) -> Iterator[Finding]:
    """A groove that narrows towards the target; a slot that the tip starts in, with both walls in it.

    In a groove of half angle a, a wall that gives by d lets the tip in by d / sin a.
    """
    for degrees, gap in ((15, 0.005), (5, 0.011)):
        mesh = shapes.facing(shapes.groove(np.radians(degrees), gap), shapes.bent(), 0)
        on = shapes.alone(mesh)
        mild, stiff = on.watch(held), on.watch(all_of(solref(1e-6), gains(100), held))
        yield from sound([*mild, *stiff], what=f"{degrees} degrees")
        finer = on.watch(held, simulation=GraspSimulation(HAND, surface_patches(mesh), 0.001))
        bound = JOINT / np.sin(np.radians(degrees))
        yield agree(mild, finer, bound, f"{degrees} degrees: joints' change to 1 ms")
    for narrower in (0.0004, 0.008):
        half, what = shapes.FACE / 2 - narrower / 2, f"slot {1e3 * narrower:g} mm too narrow"
        on = shapes.alone(shapes.facing(shapes.groove(0, half), shapes.bent(), 0.01))
        simulation, bent = on.grasper.simulation, shapes.bent()
        simulation.place(np.eye(4), bent)
        yield equal(f"{what}: pose is refused", simulation.in_contact(), True)
        stuck = watch(on.grasper, simulation, on.closings[0], start=bent)
        yield equal(f"{what}: engine's warnings", stuck.warnings, 0)
        if narrower / 2 <= THICKNESS:
            yield at_most(f"{what}: moved by", float(np.abs(stuck.joints - bent).max()), JOINT, "rad")
            yield at_most(f"{what}: depth", 1e3 * stuck.depth, 1e3 * MAX_PENETRATION, "mm")


@CASES.case("faces, edges and vertices against the pad", STAGE, short=False)
def edges_and_vertices(subject) -> Iterator[Finding]:
    """In the pad's middle, at its rim and its corner, where it is chance on which side the tip slips off."""
    rim, corner = (shapes.PAD[0], 0), shapes.PAD
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
        mesh = shapes.facing(shape, shapes.bent(), at=at)
        on = shapes.alone(mesh)
        ends = [on.watch(held, simulation=GraspSimulation(HAND, surface_patches(mesh), step)) for step in TIMESTEPS[:4]]
        yield from sound(ends[1], what=name)
        if at != corner:
            yield agree(ends[1], ends[2], what=f"{name}: joints' change to 2 ms")
            yield converges(ends, name, order=2)
        yield none_unsound(on.watch(all_of(gains(100), held)), f"{name}, gains x100")


@CASES.case("a hand of another size", STAGE, short=False)
def sizes_of_hands(subject) -> Iterator[Finding]:
    """A hand of s times the size has links of s^5 times the inertia, were their density the same."""
    on, visual = setting(subject), load_visual(subject.folder)
    patches = surface_patches(load_collision(subject.folder))
    mild = on.watch(held)
    for size in (0.1, 2, 4):
        hand = resized(HAND, size)
        grasper = copy.copy(on.grasper)
        grasper.hand, mesh = hand, visual.copy().apply_scale(size)
        grasper.check, grasper.caster = PenetrationCheck(hand, mesh), RayCaster(mesh)
        grasper.simulation = GraspSimulation(hand, [size * each for each in patches])
        closings = [each._replace(pose=moved_out(each.pose, size)) for each in on.closings]
        ends = Setting(grasper, closings).watch(held)
        yield agree(ends, mild, GEL, f"x{size:g}: joints' change")
        yield from sound(ends, what=f"x{size:g}")


@CASES.case("a hand's file with extreme values", STAGE)
def extreme_files(subject) -> Iterator[Finding]:
    """Gains, armature, damping and masses of a file play no part; what can't be is an error that says so."""
    on, patches = setting(subject), surface_patches(load_collision(subject.folder))
    with TemporaryDirectory() as folder:
        ends = []
        files = {"mild": (1.0, 5e-4, 1e3), "stiff": (1e8, 0.0, 1e9), "limp": (1e-8, 1e8, 1e-3)}
        for name, values in files.items():
            hand = written(Path(folder) / f"{name}.xml", *values)
            simulation = GraspSimulation(hand, patches)
            simulation.place(on.closings[0].pose, hand.open_joint_positions)
            ends.append(simulation.close(on.closings[0].targets).joint_positions)
        for name, joints in zip(("stiff", "limp"), ends[1:], strict=True):
            yield equal(f"{name}: joints' change", float(np.abs(joints - ends[0]).max()), 0.0, "rad")
        for name, values in {"inertia": 'mass="1" diaginertia="1 1 9"', "mass": 'mass="-1"'}.items():
            file = Path(folder) / f"impossible_{name}.xml"
            file.write_text(IMPOSSIBLE.format(values))
            found = rejects(name, lambda file=file: from_mjcf(file, {"sensors": []}), ValueError, file.name)
            yield found._replace(note=found.note.replace(f"{folder}/", ""))
    reason = "from end to end, not 0.01 to 1 m: give all lengths in metres"
    for size in (10, 1000, 0.001):
        yield rejects(f"lengths x{size:g}", lambda size=size: resized(HAND, size), ValueError, reason)
    crossed, far = replace(HAND, open_joint_positions=shapes.crossed()), shapes.far()
    yield rejects(
        "open hand in itself",
        lambda: Grasper(far, far, far.triangles_center, crossed),
        ValueError,
        "deep in each other",
    )


def resized(hand: Hand, size: float) -> Hand:
    """A hand of `size` times the lengths."""
    anchor = hand.palm_anchor.copy()
    anchor[:3, 3] *= size
    return replace(
        hand,
        link_position=size * hand.link_position,
        geom_size=size * hand.geom_size,
        geom_position=size * hand.geom_position,
        sensor_position=size * hand.sensor_position,
        palm_anchor=anchor,
    )


def moved_out(pose: np.ndarray, size: float) -> np.ndarray:
    """A pose (4, 4) with its place scaled."""
    pose = pose.copy()
    pose[:3, 3] *= size
    return pose


def written(path: Path, stiffness: float, armature: float, density: float) -> Hand:
    """The hand as a model file with these servos, armature (kg m^2) and density (kg/m^3), read back."""
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
    return from_mjcf(path, {"sensors": sensors, "open": HAND.open_joint_positions.tolist()})
