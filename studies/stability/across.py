"""Stability of grasps across an object: thin, round and tapered objects, friction, weights, time steps and gains.

Each grasp that is made is simulated in all directions, or is discarded with a reason; none is deep in the object.
"""

from collections import Counter
from collections.abc import Iterator

import numpy as np
import trimesh

from palpate.batch import generator
from palpate.grasp.antipodal import AntipodalGrasper
from palpate.grasp.closing import TIMESTEP
from palpate.grasp.contacts import contacts, on_object
from palpate.grasp.hold import GAIN, GripSimulation, body_of
from palpate.grasp.patches import surface_patches
from palpate.hand import MAX_PENETRATION
from palpate.hand.model import ARM
from studies.stability.cases import Cases, Finding, at_least, at_most, equal
from studies.stability.hold import GRIPPER, HALF

CASES = Cases()
ATTEMPTS, GRIP = 5, 10.0  # of an object; N
HANDLE = trimesh.creation.torus(0.04, 0.006, 48, 16)
OBJECTS = {
    "blade of 0.3 mm": trimesh.creation.box((0.08, 0.03, 0.0003)),
    "blade of 2 mm": trimesh.creation.box((0.08, 0.03, 0.002)),
    "ball": trimesh.creation.icosphere(3, 0.03),
    "cone": trimesh.creation.cone(0.03, 0.08, sections=48),
    "handle": HANDLE,
}
# Friction, kg, time step (s).
EXTREMES = [(0.8, 0.1, TIMESTEP), (0.1, 0.1, TIMESTEP), (1.5, 0.1, TIMESTEP), (0.8, 1e-3, TIMESTEP)]
EXTREMES += [(0.8, 5.0, TIMESTEP), (0.8, 0.1, 0.001), (0.8, 0.1, 0.01)]


def tried(mesh: trimesh.Trimesh, friction: float, mass: float, timestep: float) -> tuple[Counter, list[float], float]:
    """Results of some attempts by name; how far held objects move without gravity (m); the deepest grasp (m)."""
    mesh = mesh.subdivide_to_size(0.02)
    points = trimesh.sample.sample_surface(mesh, 2000, seed=0)[0]
    hold = {"friction": friction, "density": mass / mesh.volume, "distance": 0.02, "duration": 0.5}
    grasper = AntipodalGrasper(mesh, mesh, points, GRIPPER, timestep, hold=hold, grip=GRIP)
    results, moved, deepest, rng = Counter(), [], 0.0, generator(0, "stability")
    for _ in range(ATTEMPTS):
        grasp = grasper.attempt(rng)
        if isinstance(grasp, str):
            results[grasp] += 1
            continue
        ways = [*grasper.moved(grasp.palm_pose, grasp.joint_positions, grasp.more["servo_positions"])]
        results["holds" if max(ways) <= 0.02 else "is lost"] += 1
        moved += ways
        deepest = max(deepest, grasp.penetration)
    return results, moved, deepest


@CASES.case("objects between jaws", "grasps", short=False)
def objects(subject) -> Iterator[Finding]:
    """Whatever the object, its friction and weight, and the time step: no direction fails to be simulated, and every
    attempt has a result with a name."""
    for name, mesh in OBJECTS.items():
        for friction, mass, timestep in EXTREMES:
            what = f"{name}, friction {friction:g}, {mass:g} kg, {1e3 * timestep:g} ms"
            results, moved, deepest = tried(mesh, friction, mass, timestep)
            note = ", ".join(f"{count} {result}" for result, count in results.items())
            yield equal(f"{what}: not simulated", int(np.isnan(moved).sum()), 0, "", note)
            yield at_most(f"{what}: deepest", 1e3 * deepest, 1e3 * MAX_PENETRATION, "mm")
    results = tried(OBJECTS["ball"], 0.8, 0.1, TIMESTEP)[0]
    yield at_least("a ball of 100 g: holds", results["holds"], 1)


@CASES.case("grip by gain", "grasps")
def gains(subject) -> Iterator[Finding]:
    """Jaws press a box with the grip, with gains of a tenth to ten times the default's."""
    box = trimesh.creation.box((0.03, 0.03, 2 * HALF)).apply_translation((0.0406, 0, 0))
    for gain in (0.1, 1, 10):
        body = body_of(box, 100.0)
        simulation = GripSimulation(
            GRIPPER, surface_patches(box), body, 0.8, TIMESTEP, grip=GRIP, stiffness=gain * GAIN
        )
        simulation.sides = np.array([1, -1])
        simulation.place(np.eye(4), np.full(2, HALF + 0.01))
        joints = simulation.close(np.full(2, HALF - 0.01)).joint_positions
        servo = gain * GAIN / ARM**2 * (joints - simulation.data.ctrl)
        yield at_most(f"gain x{gain:g}: servos off the grip", 100 * np.abs(servo / GRIP - 1).max(), 5, "%")
        force = on_object(contacts(simulation)).force.sum() / 2
        yield at_most(f"gain x{gain:g}: contacts off the grip", 100 * abs(force / GRIP - 1), 5, "%")
