"""A `Hand` as a MuJoCo specification: joints with position servos, and those of its geoms that collide."""

from typing import Any

import mujoco
import numpy as np

from palpate.hand.hand import GEOM_KINDS, Hand

MUJOCO_GEOM = {kind: getattr(mujoco.mjtGeom, f"mjGEOM_{kind.upper()}") for kind in GEOM_KINDS}
# Of a hinge; closing is stable with these at a time step of 4 ms. With kp 100 the tips end 9.8 mm in the object.
STIFFNESS = 1.0  # N m / rad
MAX_TORQUE = 0.5  # N m
ARMATURE = 5e-4  # kg m^2
DAMPING = 0.01  # N m s / rad
# kg m^2, of the open hand's links about a hinge: three times the armature. Heavier links swing past their targets and
# still move at the end of a closing: a hand of twice the Allegro's size, by 7 degrees.
LARGEST_INERTIA = 1.5e-3
# m, about a finger's length. It makes a slide's constants of a hinge's: stiffness, damping and armature are divided by
# its square, and the largest torque by itself.
ARM = 0.1
LIMITED = mujoco.mjtLimited.mjLIMITED_FALSE, mujoco.mjtLimited.mjLIMITED_TRUE
LEAST_MASS, LEAST_INERTIA = 1e-3, 1e-7  # of links without a volume of their own (a second hinge of one body)


def build_spec(hand: Hand, stiffness: float = STIFFNESS) -> mujoco.MjSpec:
    """The hand as an `MjSpec`; bodies, joints and servos are named as their links. The palm is fixed to the world;
    joints without a servo follow by equalities. `stiffness`: the servos' gain in N m / rad (of slides / ARM^2, N / m),
    critically damped. Links have the density of water, or less (`LARGEST_INERTIA`). Omitted are geoms that are only
    drawn, and contacts of the hand with itself that are not in its `colliding_pairs`."""
    spec = mujoco.MjSpec()
    # The default is True: ranges in radians would silently become limits 57 times as narrow.
    spec.compiler.degree = False
    spec.compiler.boundmass, spec.compiler.boundinertia = LEAST_MASS, LEAST_INERTIA
    squared_arm = np.where(hand.joint_slides, ARM**2, 1.0)  # (J,), by which a hinge's constants are divided
    armature = ARMATURE / squared_arm
    bodies: list[mujoco.MjsBody] = []
    for link, name in enumerate(hand.link_names):
        parent = spec.worldbody if link == 0 else bodies[hand.link_parent[link]]
        body = parent.add_body(name=name, pos=hand.link_position[link], quat=quaternion(hand.link_rotation[link]))
        bodies.append(body)
        for joint in np.flatnonzero(hand.joint_link == link):
            added = body.add_joint(name=name, axis=hand.joint_axis[joint], range=hand.joint_range[joint])
            added.type = mujoco.mjtJoint.mjJNT_SLIDE if hand.joint_slides[joint] else mujoco.mjtJoint.mjJNT_HINGE
            added.limited = LIMITED[int(hand.joint_driver[joint] == joint)]
            added.armature, added.damping = armature[joint], [DAMPING / squared_arm[joint], 0, 0]
    names = [hand.link_names[link] for link in hand.joint_link]
    moved = hand.follow_slopes(hand.open_joint_positions) ** 2 * armature[:, None]
    for joint in hand.drivers:
        servo = spec.add_actuator(name=names[joint], target=names[joint], trntype=mujoco.mjtTrn.mjTRN_JOINT)
        # Critically damped against the armature, with that of joints that follow.
        kp, share = stiffness / squared_arm[joint], moved[:, joint].sum() / armature[joint]
        servo.set_to_position(kp=kp, kv=2 * np.sqrt(stiffness * ARMATURE) / squared_arm[joint] * np.sqrt(share))
        servo.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
        force = MAX_TORQUE / np.sqrt(squared_arm[joint])
        servo.forcerange = [-force, force]
    for joint in np.setdiff1d(np.arange(len(names)), hand.drivers):
        spec.add_equality(
            type=mujoco.mjtEq.mjEQ_JOINT,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            name1=names[joint],
            name2=names[hand.joint_driver[joint]],
            data=np.pad(hand.joint_coupling[joint], (0, mujoco.mjNEQDATA - 5)),
        )
    for geom in np.flatnonzero(hand.geom_collides):
        add_geom(spec, bodies[hand.geom_link[geom]], hand, geom)
    # No contact of two links unless each geom of one collides with each of the other, and of adjacent ones; their pairs
    # that do collide are named one by one.
    count = np.bincount(hand.geom_link[hand.geom_collides], minlength=len(hand.link_names))
    colliding = np.zeros((len(count), len(count)), dtype=int)
    links = hand.geom_link[hand.colliding_pairs]
    np.add.at(colliding, tuple(links.T), 1)
    excluded = (colliding + colliding.T < np.outer(count, count)) | hand.adjacent_links()
    for one, other in np.argwhere(np.triu(excluded, k=1)):
        spec.add_exclude(bodyname1=hand.link_names[one], bodyname2=hand.link_names[other])
    for one, other in hand.colliding_pairs[excluded[tuple(links.T)]]:
        spec.add_pair(geomname1=f"hand_geom_{one}", geomname2=f"hand_geom_{other}", condim=1)
    # As much density off all geoms that no joint has to move more than `LARGEST_INERTIA`, slides at `ARM`.
    model = spec.compile()
    model.qpos0[:] = hand.open_joint_positions
    mujoco.mj_setConst(model, mujoco.MjData(model))
    inertia = (squared_arm * (model.dof_M0 - model.dof_armature)).max(initial=0)
    for geom in spec.geoms:
        geom.density *= min(1.0, LARGEST_INERTIA / max(inertia, 1e-300))
    return spec


def add_geom(spec: mujoco.MjSpec, body: mujoco.MjsBody, hand: Hand, geom: int) -> mujoco.MjsGeom:
    """One of the hand's geoms on its link's body."""
    kind, name = hand.geom_kind[geom], f"hand_geom_{geom}"
    more: dict[str, Any] = {"pos": hand.geom_position[geom], "quat": quaternion(hand.geom_rotation[geom])}
    if kind == "mesh":
        spec.add_mesh(name=name, uservert=hand.geom_vertices[geom].ravel())
        more["meshname"] = name
    return body.add_geom(name=name, type=MUJOCO_GEOM[kind], size=hand.geom_size[geom], condim=1, **more)


def quaternion(rotation: np.ndarray) -> np.ndarray:
    """The quaternion (w, x, y, z) of a rotation matrix (3, 3)."""
    result = np.zeros(4)
    mujoco.mju_mat2Quat(result, np.ascontiguousarray(rotation, dtype=float).ravel())
    return result
