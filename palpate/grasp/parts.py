"""Parts of a closing's scene that its plan has or leaves out (`palpate.scene`), as MuJoCo specifications."""

from itertools import combinations, product

import mujoco
import numpy as np
import trimesh

from palpate.hand import Hand
from palpate.hand.model import DRAWN_ONLY
from palpate.scene import Plan

PALM = 0  # the palm is link 0
GRAVITY = 9.81  # m / s^2, along -z
FRICTIONLESS, FRICTION = 1, 3  # MuJoCo's dimensions of a contact
LOOSE, HELD = 0.3, 100.0  # kg: the object, and the object with what holds it
GYRATION = 0.14  # m: the object's radius of gyration
# Impedance of the weld that holds the object: it gives way by less than 1e-7 m.
WELD_SOLIMP = (0.9999, 0.9999, 0.001, 0.5, 2.0)


def put_in(spec: mujoco.MjSpec, plan: Plan, hand: Hand, visual: trimesh.Trimesh | None, timestep: float) -> None:
    """All that the plan has besides the hand and the object's patches.

    visual: the object's visual mesh, if there is one to put in; timestep: seconds.
    """
    if plan.needs("visual geometry") and visual is not None:
        add_visual(spec, visual)
    if plan.needs("loose object"):
        free_object(spec, LOOSE)
    elif plan.needs("object degrees of freedom"):
        free_object(spec, HELD)
        weld_object(spec, timestep)
    add_weight(spec, plan)
    for geom in spec.geoms:
        geom.condim = FRICTION if plan.needs("friction") else FRICTIONLESS
    if not plan.needs("self-collision"):
        collide_only_with_object(spec)
    add_pairs(spec, hand, plan)


def add_object(spec: mujoco.MjSpec, patches: list[np.ndarray]) -> None:
    """The body `object`, which the world holds, with a geom for each patch."""
    body = spec.worldbody.add_body(name="object")
    for number, vertices in enumerate(patches):
        name = patch_name(number)
        mesh = spec.add_mesh(name=name, uservert=vertices.ravel())
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # a sheet has no volume
        body.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name)


def patch_name(number: int) -> str:
    """The name of the mesh and of the geom of a patch of the object."""
    return f"patch_{number}"


def add_visual(spec: mujoco.MjSpec, visual: trimesh.Trimesh) -> None:
    """The object's every face, as a geom that nothing collides with."""
    vertices, faces = np.asarray(visual.vertices), np.asarray(visual.faces)
    mesh = spec.add_mesh(name="visual", uservert=vertices.ravel(), userface=faces.ravel())
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    spec.body("object").add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="visual", **DRAWN_ONLY)


def free_object(spec: mujoco.MjSpec, mass: float) -> None:
    """Give the object, of `mass` kg, its six degrees of freedom."""
    body = spec.body("object")
    body.add_freejoint()
    body.explicitinertial, body.mass, body.ipos = True, mass, [0, 0, 0]
    body.inertia = [mass * GYRATION**2] * 3


def weld_object(spec: mujoco.MjSpec, timestep: float) -> None:
    """Hold a free object where it is, by forces."""
    weld = spec.add_equality(
        type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY, name1="object", name2="world"
    )
    weld.solref, weld.solimp = [2 * timestep, 1], WELD_SOLIMP


def add_weight(spec: mujoco.MjSpec, plan: Plan) -> None:
    """Gravity, if the plan has it, and what carries everything, unless the plan lets it sag."""
    sags = plan.needs("sag under gravity")
    heavy = sags or plan.needs("gravity")
    spec.option.gravity = [0, 0, -GRAVITY if heavy else 0]
    if heavy and not sags:
        for body in spec.bodies:
            body.gravcomp = 1


def add_pairs(spec: mujoco.MjSpec, hand: Hand, plan: Plan) -> None:
    """Pairs of geoms that the engine would not look at: both are held by the world, or of one body."""
    palm, patches = colliding(spec, hand.link_names[PALM]), colliding(spec, "object")
    pairs = []
    if plan.needs("pairs of palm and object"):
        pairs += product(palm, patches)
    if plan.needs("pairs of object patches"):
        pairs += combinations(patches, 2)
    for one, other in pairs:
        spec.add_pair(geomname1=one, geomname2=other)


def colliding(spec: mujoco.MjSpec, body: str) -> list[str]:
    """The names of a body's geoms that something may collide with."""
    return [geom.name for geom in spec.body(body).geoms if geom.contype or geom.conaffinity]


def left_out(plan: Plan, hand: Hand, patches: int, visual_faces: int) -> dict[str, int]:
    """How much of each part that can be counted the plan leaves out of the scene of one object."""
    palm = int((hand.geom_collides & (hand.geom_link == PALM)).sum())
    count = {
        "visual geometry": (visual_faces, "visual faces"),
        "pairs of palm and object": (palm * patches, "pairs of palm and object"),
        "pairs of object patches": (patches * (patches - 1) // 2, "pairs of object patches"),
    }
    return {what: number for part, (number, what) in count.items() if not plan.needs(part)}


def collide_only_with_object(spec: mujoco.MjSpec) -> None:
    """Let the hand's geoms pass through each other."""
    for geom in spec.geoms:
        if geom.contype:
            of_object = geom.parent.name == "object"
            geom.contype, geom.conaffinity = int(not of_object), int(of_object)
