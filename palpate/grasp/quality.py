"""How well contacts hold an object, whatever the weight: the largest disturbance that they resist, and how far their
forces are from slipping."""

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from palpate.grasp.contacts import Contacts
from palpate.grasp.targets import tangents

EDGES = 8  # of the pyramid inside a friction cone
MOST = 16  # contacts whose cones are taken: those with the largest forces
FLAT = 1e-7  # a smaller radius, of forces that sum to 1, is rounding
PRESSED = 0.02  # of the force on the object: a finger with less says nothing about slipping


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
    """Radius (N) of the largest ball of wrenches, about `centre` (3,), that the contacts resist with normal forces
    whose sum is that at rest: the distance to the nearest facet of the hull of their cones' edges (Ferrari and Canny,
    1992). Torques count over `length` (m). 0 if some wrench is not resisted at all. All contacts are with the object.
    """
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
