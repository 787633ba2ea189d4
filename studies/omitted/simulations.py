"""Variants of `GraspSimulation` with an item more or less, and naive penetration checks."""

from collections.abc import Callable, Iterable
from itertools import combinations, product

import mujoco
import numpy as np
import trimesh

from palpate.grasp.closing import GraspSimulation
from palpate.grasp.penetration import PenetrationCheck
from palpate.hand import Hand
from palpate.hand.model import add_geom

GRAVITY = 9.81  # m / s^2, along -z
FRICTION = 3  # MuJoCo's dimensions of a contact with friction
LOOSE, HELD = 0.3, 100.0  # kg: the object alone, and fixed by a weld
GYRATION = 0.14  # m: the object's radius of gyration
# Impedance of the weld that holds the object, which moves by less than 1e-7 m.
WELD_SOLIMP = (0.9999, 0.9999, 0.001, 0.5, 2.0)


class ChangedSimulation(GraspSimulation):
    """A `GraspSimulation` with changes to its specification, which are functions of `CHANGES` by their items.

    visual: the object's visual mesh, every face.
    """

    def __init__(
        self, hand: Hand, patches: list[np.ndarray], timestep: float, items: Iterable[str], visual: trimesh.Trimesh
    ):
        self.items, self.visual = tuple(items), visual
        super().__init__(hand, patches, timestep)

    def specification(self) -> mujoco.MjSpec:
        """The engine's specification with the changes of `items`."""
        spec = super().specification()
        for item in self.items:
            CHANGES[item](self, spec)
        return spec


def add_visual_geometry(simulation: ChangedSimulation, spec: mujoco.MjSpec) -> None:
    """Add every face of the object and the hand's visual geoms, all without collisions."""
    vertices, faces = np.asarray(simulation.visual.vertices), np.asarray(simulation.visual.faces)
    mesh = spec.add_mesh(name="visual", uservert=vertices.ravel(), userface=faces.ravel())
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    drawn = [spec.body("object").add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="visual")]
    hand = simulation.hand
    for geom in np.flatnonzero(~hand.geom_collides):
        drawn.append(add_geom(spec, spec.body(hand.link_names[hand.geom_link[geom]]), hand, geom))
    for geom in drawn:
        geom.contype = geom.conaffinity = geom.mass = 0


def add_gravity(spec: mujoco.MjSpec, compensation: float) -> None:
    """Add gravity, and for every body this share of its compensation."""
    spec.option.gravity = [0, 0, -GRAVITY]
    for body in spec.bodies:
        body.gravcomp = compensation


def loosen_object(spec: mujoco.MjSpec, mass: float, held: bool) -> None:
    """Free the six degrees of freedom of the object, of `mass` kg; held: by a weld."""
    body = spec.body("object")
    body.add_freejoint()
    body.explicitinertial, body.mass, body.ipos = True, mass, [0, 0, 0]
    body.inertia = [mass * GYRATION**2] * 3
    if held:
        kinds = {"type": mujoco.mjtEq.mjEQ_WELD, "objtype": mujoco.mjtObj.mjOBJ_BODY}
        weld = spec.add_equality(name1="object", name2="world", **kinds)
        weld.solref, weld.solimp = [2 * spec.option.timestep, 1], WELD_SOLIMP


def add_palm_pairs(simulation: ChangedSimulation, spec: mujoco.MjSpec) -> None:
    """Add contact pairs of palm and object, which the engine skips because both are fixed to the world."""
    for one, other in product(_colliding(spec, simulation.hand.link_names[0]), _colliding(spec, "object")):
        spec.add_pair(geomname1=one, geomname2=other)


def add_patch_pairs(spec: mujoco.MjSpec) -> None:
    """Add contact pairs between patches of the object, which the engine skips because they are one body."""
    for one, other in combinations(_colliding(spec, "object"), 2):
        spec.add_pair(geomname1=one, geomname2=other)


def _colliding(spec: mujoco.MjSpec, body: str) -> list[str]:
    return [geom.name for geom in spec.body(body).geoms if geom.contype or geom.conaffinity]


def collide_joined_links(spec: mujoco.MjSpec) -> None:
    """Enable contacts between links that a hinge joins."""
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_FILTERPARENT
    for exclude in list(spec.excludes):
        spec.delete(exclude)


def add_friction(spec: mujoco.MjSpec) -> None:
    """Add friction to contacts."""
    for geom in spec.geoms:
        geom.condim = FRICTION


def collide_only_with_object(spec: mujoco.MjSpec) -> None:
    """Let the hand's geoms pass through each other."""
    for geom in spec.geoms:
        if geom.contype:
            of_object = geom.parent.name == "object"
            geom.contype, geom.conaffinity = int(not of_object), int(of_object)


# All but the last add an item; the last removes self-collision, which the engine has.
CHANGES: dict[str, Callable[[ChangedSimulation, mujoco.MjSpec], None]] = {
    "visual geometry": add_visual_geometry,
    "gravity": lambda _, spec: add_gravity(spec, compensation=1),
    "object degrees of freedom": lambda _, spec: loosen_object(spec, HELD, held=True),
    "pairs of palm and object": add_palm_pairs,
    "pairs of object patches": lambda _, spec: add_patch_pairs(spec),
    "pairs of joined links": lambda _, spec: collide_joined_links(spec),
    "friction": lambda _, spec: add_friction(spec),
    "sag under gravity": lambda _, spec: add_gravity(spec, compensation=0),
    "loose object": lambda _, spec: loosen_object(spec, LOOSE, held=False),
    "self-collision": lambda _, spec: collide_only_with_object(spec),
}


class EveryFace(PenetrationCheck):
    """A penetration check of every face of the object for every link."""

    def meeting(self, low: np.ndarray, *_) -> np.ndarray:
        """All triangles meet all boxes: (B, T) bool, all True."""
        return np.ones((len(low), len(self.triangles)), dtype=bool)


class EveryPair(PenetrationCheck):
    """A penetration check of every pair of links that are not joined."""

    def separated(self, poses: np.ndarray, surfaces: dict[int, np.ndarray]) -> np.ndarray:
        """No pair counts as separated: (P,) bool, all False."""
        return np.zeros(len(self.hand.colliding_pairs), dtype=bool)
