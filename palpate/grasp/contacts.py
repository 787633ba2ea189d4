"""Contacts of the hand: where it is pressed, by what, and how hard; the wrenches at its sensors; and how well contacts
hold an object, whatever its weight.

A servo presses with its gain times the way that is left to its target. In a closing contacts have no friction and the
object is held: docs/forces.md says what that makes of the numbers.
"""

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.spatial import ConvexHull, QhullError

from palpate.grasp.closing import GraspSimulation
from palpate.touch.presses import tangents

STEEPEST = np.cos(np.radians(45))  # of the angle to a sensor's axis at which a contact still presses its face
SLOTS = 32  # contacts that are stored of a frame: of 40 grasps the most had 10
OBJECT = -1  # in place of the number of a link

# Of `cone_margin` and `wrench_radius`.
EDGES = 8  # of the pyramid inside a friction cone
MOST = 16  # contacts whose cones are taken: those with the largest forces
FLAT = 1e-7  # a smaller radius, of forces that sum to 1, is rounding
PRESSED = 0.02  # of the force on the object: a finger with less says nothing about slipping


class Contacts(NamedTuple):
    """The n contacts of one state, those with the largest forces first; the normal force pushes the link."""

    position: np.ndarray  # (n, 3) m, in the middle between the two surfaces
    normal: np.ndarray  # (n, 3) unit vectors into the link
    force: np.ndarray  # (n,) N, at least 0
    link: np.ndarray  # (n,) int
    other: np.ndarray  # (n,) int: the link that it touches, or `OBJECT`
    tangential: np.ndarray  # (n, 3) N, by friction, on the link


def contacts(simulation: GraspSimulation) -> Contacts:
    """The contacts in the present state of a simulation, in the object's own frame. After a step the engine still has
    those before it. So they are computed anew, on a copy: the simulation goes on as if nothing had been asked."""
    model, data = simulation.model, mujoco.MjData(simulation.model)
    mujoco.mj_copyState(model, simulation.data, data, mujoco.mjtState.mjSTATE_INTEGRATION)
    mujoco.mj_forward(model, data)
    link_of_body = np.full(model.nbody, OBJECT)
    for link, name in enumerate(simulation.hand.link_names):
        link_of_body[model.body(name).id] = link
    first, second = link_of_body[model.geom_bodyid[data.contact.geom]].reshape(-1, 2).T
    swapped = second == OBJECT
    force = np.zeros((data.ncon, 6))
    for number, wrench in enumerate(force):
        mujoco.mj_contactForce(model, data, number, wrench)
    frame, sign = data.contact.frame.reshape(-1, 3, 3), np.where(swapped, -1, 1)[:, None]  # normals are of the second
    unordered = Contacts(
        position=data.contact.pos,
        normal=frame[:, 0] * sign,
        force=force[:, 0],
        link=np.where(swapped, first, second),
        other=np.where(swapped, second, first),
        tangential=(force[:, None, 1:3] @ frame[:, 1:])[:, 0] * sign,
    )
    if simulation.loose:
        pose = simulation.object_pose
        vectors = {name: getattr(unordered, name) @ pose[:3, :3] for name in ("normal", "tangential")}
        unordered = unordered._replace(position=(unordered.position - pose[:3, 3]) @ pose[:3, :3], **vectors)
    order = np.argsort(-unordered.force, kind="stable")
    return Contacts(*(values[order] for values in unordered))


def on_object(touching: Contacts) -> Contacts:
    """Those of the contacts that are with the object."""
    return Contacts(*(values[touching.other == OBJECT] for values in touching))


def sensor_wrenches(touching: Contacts, links: np.ndarray, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Force (N) and torque (N m) of the object on each sensor's link: (s, 6), in the sensor's frame and at its origin.
    links: (s,) int of the sensors. position, rotation: (s, 3) and (s, 3, 3), in the frame of the contacts."""
    on_link = (touching.link == links[:, None]) & (touching.other == OBJECT)
    forces = (on_link * touching.force)[..., None] * touching.normal  # (s, n, 3)
    torques = np.cross(touching.position - position[:, None], forces)
    sums = [vectors.sum(axis=1, keepdims=True) @ rotation for vectors in (forces, torques)]
    return np.concatenate(sums, axis=-1)[:, 0]


def pad_forces(found: Contacts, links: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """How hard the object presses each sensor's face: (s,) N along its axis; arguments as for `sensor_wrenches`.
    Contacts that push at more than 45 degrees to the axis are of the link's sides or back and do not count."""
    on_link = (found.link == links[:, None]) & (found.other == OBJECT)
    cosine = -rotation[:, :, 0] @ found.normal.T  # (s, n): 1 where the object pushes straight onto the face
    return np.where(on_link & (cosine > STEEPEST), found.force * cosine, 0).sum(axis=1)


def contact_arrays(
    frames: Sequence[Contacts], links: np.ndarray, position: np.ndarray, rotation: np.ndarray
) -> dict[str, np.ndarray]:
    """The contacts of f frames by the contract's names, (f, ...), and the sensors' wrenches; links, position, rotation:
    as for `sensor_wrenches`, of each frame. `contact_count` counts all; the `SLOTS` with the largest forces are kept;
    empty slots are 0."""
    arrays = {"contact_count": np.array([len(frame.force) for frame in frames])}
    for name in Contacts._fields[:-1]:
        columns = [getattr(frame, name)[:SLOTS] for frame in frames]
        padded = np.zeros((len(frames), SLOTS, *columns[0].shape[1:]), columns[0].dtype)
        for slots, values in zip(padded, columns, strict=True):
            slots[: len(values)] = values
        arrays[f"contact_{name}"] = padded
    poses = zip(frames, position, rotation, strict=True)
    wrenches = [sensor_wrenches(frame, links, place, turn) for frame, place, turn in poses]
    return arrays | {"sensor_wrench": np.array(wrenches)}


def cone_margin(contacts: Contacts, friction: float) -> float:
    """Share of the friction that is left at rest, of the link that is nearest to slipping: 1 - tangential force /
    (friction x normal force); 0 slips, or no contact. All contacts are with the object."""
    margins, normals = [], contacts.force[:, None] * contacts.normal
    for link in np.unique(contacts.link):
        mine = contacts.link == link
        if contacts.force[mine].sum() > PRESSED * contacts.force.sum():
            normal, tangential = (np.linalg.norm(forces[mine].sum(axis=0)) for forces in (normals, contacts.tangential))
            margins.append(1 - tangential / (friction * normal) if friction else 0.0)
    return float(max(0.0, min(margins, default=0.0)))


def wrench_radius(contacts: Contacts, friction: float, centre: np.ndarray, length: float) -> float:
    """Radius (N) of the largest ball of wrenches, about `centre` (3,), that the contacts, all with the object, resist
    with normal forces whose sum is that at rest: the distance to the nearest facet of the hull of their cones' edges
    (Ferrari and Canny, 1992). Torques count over `length` (m). 0 if some wrench is not resisted at all."""
    position, normal = contacts.position[:MOST], contacts.normal[:MOST]
    turn = 2 * np.pi * np.arange(EDGES) / EDGES
    edges = normal[:, None] + friction * np.stack([np.cos(turn), np.sin(turn)], axis=-1) @ tangents(normal)
    torques = np.cross((position - centre)[:, None], edges) / length
    try:
        # Joggled: several contacts of one face are nearly the same point, whose facets can't be merged.
        hull = ConvexHull(np.concatenate([edges, torques], axis=-1).reshape(-1, 6), qhull_options="QJ")
    except (QhullError, ValueError):  # flat, or too few points: no force along some wrench
        return 0.0
    radius = -hull.equations[:, -1].max()
    return float(contacts.force.sum() * radius) if radius > FLAT else 0.0
