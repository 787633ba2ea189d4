"""How well contacts hold an object, whatever the weight: the largest disturbance that they resist, and how far their
forces are from slipping."""

from typing import NamedTuple

import mujoco
import numpy as np
from scipy.spatial import ConvexHull, QhullError

EDGES = 8  # of the pyramid inside a friction cone
MOST = 16  # contacts whose cones are taken: those with the largest forces
FLAT = 1e-7  # a smaller radius, of forces that sum to 1, is rounding
PRESSED = 0.02  # of the force on the object: a finger with less says nothing about slipping


class ObjectContacts(NamedTuple):
    """The n contacts of the hand with the object, those with the largest forces first."""

    position: np.ndarray  # (n, 3) m
    frame: np.ndarray  # (n, 3, 3) rows: the normal into the object, and two tangents
    force: np.ndarray  # (n, 3) N along them
    body: np.ndarray  # (n,) int: the engine's number of the link's body


def object_contacts(model: mujoco.MjModel, data: mujoco.MjData, body: int) -> ObjectContacts:
    """The contacts of the object with this body's number in a state whose contacts are computed."""
    bodies, force = model.geom_bodyid[data.contact.geom].reshape(-1, 2), np.zeros((data.ncon, 6))
    for number, row in enumerate(force):
        mujoco.mj_contactForce(model, data, number, row)
    mine = np.flatnonzero((bodies == body).any(axis=1) & (bodies[:, 0] != bodies[:, 1]))
    mine = mine[np.argsort(-force[mine, 0], kind="stable")]
    sign = np.where(bodies[mine, 1] == body, 1.0, -1.0)[:, None, None]  # the engine's normal is into the second body
    frame = sign * data.contact.frame[mine].reshape(-1, 3, 3)
    return ObjectContacts(data.contact.pos[mine], frame, force[mine, :3], bodies[mine].sum(axis=1) - body)


def cone_margin(contacts: ObjectContacts, friction: float) -> float:
    """Share of the friction that is left at rest, of the link that is nearest to slipping: 1 - tangential force /
    (friction x normal force); 0 slips, or no contact."""
    margins, total = [], contacts.force[:, 0].sum()
    for link in np.unique(contacts.body):
        mine = contacts.body == link
        forces, normals = contacts.force[mine], contacts.frame[mine, 0]
        pressed = forces[:, 0].sum()
        if pressed > PRESSED * total:
            tangential = (forces[:, 1:, None] * contacts.frame[mine, 1:]).sum(axis=(0, 1))
            normal = (forces[:, :1] * normals).sum(axis=0)
            slope = np.linalg.norm(normal) / pressed  # of contacts that face different ways
            margins.append(1 - np.linalg.norm(tangential) / (friction * slope * pressed) if friction else 0.0)
    return float(max(0.0, min(margins, default=0.0)))


def wrench_radius(contacts: ObjectContacts, friction: float, centre: np.ndarray, length: float) -> float:
    """Radius (N) of the largest ball of wrenches, about `centre` (3,), that the contacts resist with normal forces
    whose sum is that at rest: the distance to the nearest facet of the hull of their cones' edges (Ferrari and Canny,
    1992). Torques count over `length` (m). 0 if some wrench is not resisted at all.
    """
    position, frame, total = contacts.position[:MOST], contacts.frame[:MOST], contacts.force[:, 0].sum()
    turn = 2 * np.pi * np.arange(EDGES) / EDGES
    edges = np.stack([np.ones(EDGES), friction * np.cos(turn), friction * np.sin(turn)], axis=-1) @ frame
    torques = np.cross((position - centre)[:, None], edges) / length
    try:
        # Joggled: several contacts of one face are nearly the same point, whose facets can't be merged.
        hull = ConvexHull(np.concatenate([edges, torques], axis=-1).reshape(-1, 6), qhull_options="QJ")
    except (QhullError, ValueError):  # flat, or too few points: no force along some wrench
        return 0.0
    radius = -hull.equations[:, -1].max()
    return float(total * radius) if radius > FLAT else 0.0
