"""Penetration of the hand into the object or itself: closed forms against true surfaces, without the engine."""

from collections.abc import Callable

import numpy as np
import trimesh

from palpate.grasp.patches import halved, split_long_edges
from palpate.hand import Hand

SPACING = 0.001  # metres between points of a surface where it is near a geom
COARSE = 0.016  # metres: longest edge of the triangles that are first sorted out by their place


def deepest(triangles: np.ndarray, distance: Callable[[np.ndarray], np.ndarray], depth: float) -> float:
    """Depth of the deepest point of triangles (T, 3, 3) in a solid, or `depth` if that is deeper.

    distance: signed distance (N,) of points (N, 3) to the solid, negative inside. It changes by at most 1 m a metre:
    triangles whose centres are farther out than their radius are dropped. The others are halved until measured points
    are at most `SPACING` apart.
    """
    while len(triangles):
        centres = triangles.mean(axis=1)
        radius = np.linalg.norm(triangles - centres[:, None], axis=2).max(axis=1)
        at_centre = -distance(centres)
        near = at_centre + radius > depth
        triangles, radius = triangles[near], radius[near]
        if len(triangles):
            depth = max(depth, at_centre.max(), -distance(triangles.reshape(-1, 3)).min())
        # No two neighbouring points of a triangle of this radius, corners and centre, are farther apart.
        triangles = halved(triangles[radius > SPACING])
    return depth


class PenetrationCheck:
    """The depth of one hand in one object, and in itself. Frames: the object's own.

    Omitted are faces whose bounding boxes are outside a link's, and pairs of links with a plane between them:
    none of their points can be inside.
    """

    def __init__(self, hand: Hand, mesh: trimesh.Trimesh):
        """mesh: the object's visual mesh, every face; it need not be closed."""
        self.hand = hand
        self.triangles = split_long_edges(np.asarray(mesh.triangles, dtype=float), COARSE)
        self.low, self.high = self.triangles.min(axis=1).T.copy(), self.triangles.max(axis=1).T.copy()
        self.geoms = np.flatnonzero(hand.geom_collides)
        self.surfaces = {geom: geom_surface(hand, geom) for geom in self.geoms}
        self.reach = {geom: np.linalg.norm(s.reshape(-1, 3), axis=1).max() for geom, s in self.surfaces.items()}
        links = hand.geom_link[self.geoms]
        may_collide = ~hand.adjacent_links()[links[:, None], links[None, :]]
        self.pairs = self.geoms[np.argwhere(np.triu(may_collide, k=1))]  # (P, 2) of geoms on links that may collide

    def in_object(self, link_pose: np.ndarray) -> float:
        """Metres of the deepest point of the object's surface in the hand, or 0; link_pose: (L, 4, 4).

        Right to half of `SPACING`, and mostly far better, for the surface's corners are among the points.
        """
        poses = self.hand.geom_poses(link_pose)
        half = np.array([self.reach[geom] for geom in self.geoms])[:, None]
        near = self.meeting(self.low, self.high, poses[self.geoms, :3, 3] - half, poses[self.geoms, :3, 3] + half)
        triangles, low, high = self.triangles[near], self.low[:, near], self.high[:, near]
        depth = 0.0
        for geom in self.geoms:
            centre, reach = poses[geom, None, :3, 3], self.reach[geom]
            close = self.meeting(low, high, centre - reach, centre + reach)
            depth = deepest(triangles[close], self.distance_to(geom, poses), depth)
        return float(depth)

    def distance_to(self, geom: int, poses: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """The function that gives signed distances (N,) of points (N, 3) to a geom; poses: (G, 4, 4) of all."""
        return lambda points: self.hand.geom_distance(geom, points, poses[geom])

    def in_itself(self, link_pose: np.ndarray) -> float:
        """Metres of the deepest point of a link's surface in another link, not joined to it; link_pose: (L, 4, 4)."""
        poses = self.hand.geom_poses(link_pose)
        surfaces = {
            geom: surface @ poses[geom, :3, :3].T + poses[geom, :3, 3] for geom, surface in self.surfaces.items()
        }
        depth = 0.0
        for one, other in self.pairs[~self.separated(poses, surfaces)]:
            for inner, outer in ((one, other), (other, one)):
                depth = deepest(surfaces[inner], self.distance_to(outer, poses), depth)
        return float(depth)

    def separated(self, poses: np.ndarray, surfaces: dict[int, np.ndarray]) -> np.ndarray:
        """Which pairs of geoms a plane across an axis of either geom separates: (P,) bool.

        poses: (G, 4, 4) of all geoms; surfaces: triangles (T, 3, 3) of each colliding one, placed.
        """
        starts = np.cumsum([0] + [3 * len(surfaces[geom]) for geom in self.geoms])[:-1]
        corners = np.concatenate([surfaces[geom].reshape(-1, 3) for geom in self.geoms])
        axes = poses[self.geoms, :3, :3].swapaxes(-1, -2).reshape(-1, 3)
        along = axes @ corners.T  # (3 G, corners)
        low, high = np.minimum.reduceat(along, starts, axis=1), np.maximum.reduceat(along, starts, axis=1)
        # separates[i, k, j]: axis k of geom i has geom j wholly on one side of geom i
        count = len(self.geoms)
        low, high = low.reshape(count, 3, count), high.reshape(count, 3, count)
        own = np.arange(count)
        own_low, own_high = low[own, :, own][:, :, None], high[own, :, own][:, :, None]
        separates = ((low >= own_high) | (high <= own_low)).any(axis=1)
        index = np.searchsorted(self.geoms, self.pairs)
        return separates[index[:, 0], index[:, 1]] | separates[index[:, 1], index[:, 0]]

    def meeting(self, low: np.ndarray, high: np.ndarray, lowest: np.ndarray, highest: np.ndarray) -> np.ndarray:
        """Indices of the boxes from `low` to `high` (3, T) that meet the box around those from `lowest` to `highest`
        (B, 3)."""
        meets = np.ones(low.shape[1], dtype=bool)
        for axis in range(3):
            meets &= (low[axis] < highest[:, axis].max()) & (high[axis] > lowest[:, axis].min())
        return np.flatnonzero(meets)


def geom_surface(hand: Hand, geom: int) -> np.ndarray:
    """Triangles (T, 3, 3) of a geom's surface in its own frame."""
    size = hand.geom_size[geom]
    make = {
        "mesh": lambda: trimesh.convex.convex_hull(hand.geom_vertices[geom]),
        "box": lambda: trimesh.creation.box(2 * size),
        "sphere": lambda: trimesh.creation.icosphere(radius=size[0]),
        "capsule": lambda: trimesh.creation.capsule(height=2 * size[1], radius=size[0]),
        "cylinder": lambda: trimesh.creation.cylinder(height=2 * size[1], radius=size[0]),
        "ellipsoid": lambda: trimesh.creation.icosphere(radius=1.0).apply_scale(size),
    }
    surface = make[hand.geom_kind[geom]]()
    if hand.geom_kind[geom] == "capsule":
        surface.apply_translation(-surface.bounds.mean(axis=0))
    return np.asarray(surface.triangles)
