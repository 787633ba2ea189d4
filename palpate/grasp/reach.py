"""How far a hand can reach, and which patches of an object that leaves out."""

import mujoco
import numpy as np

from palpate.grasp.parts import patch_name
from palpate.grasp.penetration import geom_surface
from palpate.hand import Hand


def reach_of(hand: Hand) -> float:
    """Metres from the palm's origin that no point of the hand is beyond, whatever its joints do."""
    chain = np.zeros(len(hand.link_names))
    for link in range(1, len(chain)):
        chain[link] = chain[hand.link_parent[link]] + np.linalg.norm(hand.link_position[link])
    return max(
        chain[hand.geom_link[geom]]
        + np.linalg.norm(hand.geom_position[geom])
        + np.linalg.norm(geom_surface(hand, geom), axis=2).max()
        for geom in np.flatnonzero(hand.geom_collides)
    )


class Reach:
    """The patches of an object, by the balls around them."""

    def __init__(self, hand: Hand, patches: list[np.ndarray], model: mujoco.MjModel):
        """patches: (V, 3) each; model: compiled, with a geom for each patch."""
        self.reach = reach_of(hand)
        self.centres = np.array([patch.mean(axis=0) for patch in patches]).reshape(-1, 3)
        around = zip(patches, self.centres, strict=True)
        self.radii = np.array([np.linalg.norm(patch - centre, axis=1).max() for patch, centre in around])
        names = [patch_name(number) for number in range(len(patches))]
        self.geoms = np.array([model.geom(name).id for name in names], dtype=int)
        self.contype = model.geom_contype[self.geoms].copy()
        self.conaffinity = model.geom_conaffinity[self.geoms].copy()

    def within(self, palm: np.ndarray) -> np.ndarray:
        """Which patches the hand can reach with its palm's origin at (3,): bool."""
        return np.linalg.norm(self.centres - palm, axis=1) - self.radii <= self.reach

    def leave_out(self, model: mujoco.MjModel, palm: np.ndarray) -> None:
        """Let nothing collide with the patches out of reach."""
        near = self.within(palm)
        model.geom_contype[self.geoms] = self.contype * near
        model.geom_conaffinity[self.geoms] = self.conaffinity * near
