"""Penetration of the hand into the object or itself: closed forms against true surfaces, without the engine."""

from collections.abc import Callable
from functools import lru_cache, partial

import numpy as np
import trimesh

from palpate.configuration import ConfigError
from palpate.grasp.patches import halved, lengths, split_long_edges
from palpate.hand import Hand

SPACING = 0.001  # metres between points of a surface where it is near a geom
COARSE = 0.016  # metres: longest edge of the triangles that are first sorted out by their place


def deepest(triangles: np.ndarray, solid: np.ndarray, distance: Callable[..., np.ndarray]) -> float:
    """Depth of the deepest point of triangles (T, 3, 3), each in its own solid of the numbers `solid` (T,), or 0.
    distance: signed distance (N,) of points (N, 3) to solids (N,), negative inside, of slope 1 at most: triangles whose
    centres are farther out than their radius are dropped, others halved until points are at most `SPACING` apart."""
    depth = 0.0
    while len(triangles):
        centres = (triangles[:, 0] + triangles[:, 1] + triangles[:, 2]) / 3
        radius = lengths(triangles - centres[:, None]).T.copy().max(axis=0)
        at_centre = -distance(centres, solid)
        near = at_centre + radius > depth
        triangles, radius, solid = triangles[near], radius[near], solid[near]
        if len(triangles):
            depth = max(depth, at_centre.max(), -distance(triangles.reshape(-1, 3), np.repeat(solid, 3)).min())
        # No two neighbouring points of a triangle of this radius, corners and centre, are farther apart.
        coarse = radius > SPACING
        triangles, solid = halved(triangles[coarse]), np.tile(solid[coarse], 2)
    return float(depth)


class PenetrationCheck:
    """The depth of one hand in one object, and in itself. Frames: the object's own. Omitted are faces whose bounding
    boxes are outside a link's, and pairs of links with a plane between them: none of their points can be inside."""

    def __init__(self, hand: Hand, mesh: trimesh.Trimesh):
        """mesh: the object's visual mesh, every face; it need not be closed."""
        self.hand = hand
        self.triangles = split_long_edges(np.asarray(mesh.triangles, dtype=float), COARSE)
        corners = self.triangles.transpose(1, 2, 0).copy()  # along axes of length 3 numpy's minimum is slow
        self.low, self.high = corners.min(axis=0), corners.max(axis=0)
        self.geoms = np.flatnonzero(hand.geom_collides)
        self.surfaces = {geom: geom_surface(hand, geom) for geom in self.geoms}
        self.half = np.array([np.abs(surface).max(axis=(0, 1)) for surface in self.surfaces.values()])  # of their boxes

    def in_object(self, link_pose: np.ndarray) -> float:
        """Metres of the deepest point of the object's surface in the hand, or 0; link_pose: (L, 4, 4). Right to half of
        `SPACING`, and mostly far better, for the surface's corners are among the points."""
        poses = self.hand.geom_poses(link_pose)
        centre = poses[self.geoms, :3, 3]
        half = (np.abs(poses[self.geoms, :3, :3]) @ self.half[:, :, None])[..., 0]
        low, high = centre - half, centre + half
        near = np.flatnonzero(self.meeting(low.min(axis=0, keepdims=True), high.max(axis=0, keepdims=True)))
        box, close = np.nonzero(self.meeting(low, high, near))
        return deepest(self.triangles[near[close]], self.geoms[box], partial(self.distance, poses))

    def distance(self, poses: np.ndarray, points: np.ndarray, geoms: np.ndarray) -> np.ndarray:
        """Signed distances (N,) of points (N, 3) to the geoms of numbers (N,); poses: (G, 4, 4) of all."""
        distances = np.empty(len(points))
        for geom in np.unique(geoms):
            mine = geoms == geom
            distances[mine] = self.hand.geom_distance(geom, points[mine], poses[geom])
        return distances

    def require_open(self, max_penetration: float) -> None:
        """Raise ConfigError, naming the links, if the open hand is deeper in itself than metres."""
        links = self.hand.forward(np.eye(4), self.hand.open_joint_positions)
        if self.in_itself(links) <= max(0.0, max_penetration):
            return
        depth, pair = max((self.in_itself(links, pair[None]), tuple(pair)) for pair in self.hand.colliding_pairs)
        one, other = (self.hand.link_names[self.hand.geom_link[geom]] for geom in pair)
        raise ConfigError(
            f"hand {self.hand.name!r}: open, its links {one!r} and {other!r} are {1e3 * depth:.1f} mm deep in each"
            f" other, and no grasp may be deeper than {1e3 * max_penetration:g} mm: change `open` or the geoms, or"
            " exclude the pair in the model, `<contact><exclude>`"
        )

    def in_itself(self, link_pose: np.ndarray, pairs: np.ndarray | None = None) -> float:
        """Metres of the deepest point of a link's surface in another that may collide with it; link_pose: (L, 4, 4).
        pairs: (P, 2) of geoms; by default all that may collide."""
        poses = self.hand.geom_poses(link_pose)
        placed = zip(self.surfaces.items(), poses[self.geoms], strict=True)
        surfaces = {geom: surface @ pose[:3, :3].T + pose[:3, 3] for (geom, surface), pose in placed}
        pairs = self.hand.colliding_pairs[~self.separated(poses, surfaces)] if pairs is None else pairs
        pairs = np.concatenate([pairs, pairs[:, ::-1]])
        triangles = np.concatenate([np.zeros((0, 3, 3)), *(surfaces[inner] for inner in pairs[:, 0])])
        outer = np.repeat(pairs[:, 1], [len(surfaces[inner]) for inner in pairs[:, 0]])
        return deepest(triangles, outer, partial(self.distance, poses))

    def separated(self, poses: np.ndarray, surfaces: dict[int, np.ndarray]) -> np.ndarray:
        """Which pairs of geoms a plane across an axis of either geom separates: (P,) bool. poses: (G, 4, 4) of all
        geoms; surfaces: triangles (T, 3, 3) of each colliding one, placed."""
        starts = np.cumsum([0] + [3 * len(surfaces[geom]) for geom in self.geoms])[:-1]
        corners = np.concatenate([surfaces[geom].reshape(-1, 3) for geom in self.geoms])
        axes, count = poses[self.geoms, :3, :3].swapaxes(-1, -2).reshape(-1, 3), len(self.geoms)
        along = axes @ corners.T  # (3 G, corners)
        # separates[i, k, j]: axis k of geom i has geom j wholly on one side of geom i
        limits = (end.reduceat(along, starts, axis=1) for end in (np.minimum, np.maximum))
        (low, high), own = (limit.reshape(count, 3, count) for limit in limits), np.arange(count)
        own_low, own_high = low[own, :, own][:, :, None], high[own, :, own][:, :, None]
        separates = ((low >= own_high) | (high <= own_low)).any(axis=1)
        index = np.searchsorted(self.geoms, self.hand.colliding_pairs)
        return separates[index[:, 0], index[:, 1]] | separates[index[:, 1], index[:, 0]]

    def meeting(self, low: np.ndarray, high: np.ndarray, among: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Which of the object's triangles meet which of the boxes from `low` to `high` (B, 3), by their own boxes:
        (B, T) bool, of those `among` them."""
        meets = np.array(True)
        for own_low, own_high, lowest, highest in zip(self.low, self.high, low.T, high.T, strict=True):
            meets = meets & (own_low[among] < highest[:, None]) & (own_high[among] > lowest[:, None])
        return meets


@lru_cache(maxsize=64)
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
