"""The reach of a hand, and a simulation that ignores patches out of reach; the engine culls them anyway."""

import numpy as np

from palpate.grasp.closing import GraspSimulation, patch_name
from palpate.grasp.penetration import geom_surface
from palpate.hand import Hand


def reach_of(hand: Hand) -> float:
    """Upper bound (m) of the distance of any point of the hand from the palm's origin, for all joint positions."""
    chain = np.zeros(len(hand.link_names))
    for link in range(1, len(chain)):
        chain[link] = chain[hand.link_parent[link]] + np.linalg.norm(hand.link_position[link])
    return max(
        chain[hand.geom_link[geom]]
        + np.linalg.norm(hand.geom_position[geom])
        + np.linalg.norm(geom_surface(hand, geom), axis=2).max()
        for geom in np.flatnonzero(hand.geom_collides)
    )


class ReachLimitedSimulation(GraspSimulation):
    """A simulation without collisions with patches that the hand can't reach from its palm's position."""

    def __init__(self, hand: Hand, patches: list[np.ndarray], timestep: float):
        super().__init__(hand, patches, timestep)
        self.reach = reach_of(hand)
        self.centres = np.array([patch.mean(axis=0) for patch in patches]).reshape(-1, 3)
        around = zip(patches, self.centres, strict=True)
        self.radii = np.array([np.linalg.norm(patch - centre, axis=1).max() for patch, centre in around])
        names = [patch_name(number) for number in range(len(patches))]
        self.geoms = np.array([self.model.geom(name).id for name in names], dtype=int)
        self.contype = self.model.geom_contype[self.geoms].copy()
        self.conaffinity = self.model.geom_conaffinity[self.geoms].copy()

    def reachable(self, palm: np.ndarray) -> np.ndarray:
        """Which patches the hand can reach with its palm's origin at `palm` (3,): bool."""
        return np.linalg.norm(self.centres - palm, axis=1) - self.radii <= self.reach

    def place(self, palm_pose: np.ndarray, joint_positions: np.ndarray) -> None:
        """As `GraspSimulation.place`."""
        near = self.reachable(palm_pose[:3, 3])
        self.model.geom_contype[self.geoms] = self.contype * near
        self.model.geom_conaffinity[self.geoms] = self.conaffinity * near
        super().place(palm_pose, joint_positions)
