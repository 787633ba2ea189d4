"""Grasps across an object: pairs of opposing surface points, and a hand placed with its fingers on both sides.

Pairs are sampled as in ACRONYM (Eppner, Mousavian, Fox 2021): from a surface point a ray goes into the object, within
the friction cone of the normal; where it leaves the object it has to be within the friction cone there.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from palpate.grasp.targets import Surface, Workspace, solve_positive_definite
from palpate.hand import Hand
from palpate.hand.hand import rotation_about
from palpate.surface.embree import RayMesh

RAYS = 64  # traced at once
CROSSINGS = 16  # faces at most that a ray is followed through
STEP = 1e-6  # m behind a face from which its ray goes on
NARROWEST = 1e-5  # m between the points of a pair
DRAWN = 20_000  # pairs of random configurations of two fingers, of which those that oppose each other are kept
FACING = np.cos(np.radians(60))  # least cosine between the gels' directions and the line through them
KEPT = 400  # ways of opposing, at most
TRIED = 4  # of them for a pair
CLEARANCE = 0.01  # m between each gel and the surface before the hand closes
PRESS = 0.01  # m below the surface that servos aim at; from there on the grip takes over
ITERATIONS, DAMPING = 12, 1e-6  # of the inverse kinematics; m^2
CONVERGED = 0.99  # no further step if this share of the error is left
MISSED = 0.005  # m that a gel may be off its place
BESIDE = 0.02  # m that other fingers of a side look for a surface that faces them
BESIDE_FACING = np.cos(np.radians(45))


class Placement(NamedTuple):
    """A hand before it closes on a pair, in the object's frame: the palm's pose (4, 4), joint positions (J,), servos'
    targets (J,), and which side of the object each sensor presses (s,): -1 or 1, 0 for none."""

    pose: np.ndarray
    joints: np.ndarray
    targets: np.ndarray
    sides: np.ndarray


def opposing_points(
    surface: Surface, rays: RayMesh, friction: float, widest: float, rng: np.random.Generator
) -> np.ndarray:
    """Pairs of points (P, 2, 3) of the exterior at most `widest` m apart, whose normals oppose each other within the
    friction cones, with room for a finger at both: P is 0 to some of `RAYS`."""
    chosen = rng.integers(len(surface.points), size=RAYS)
    least = 1 / np.hypot(1, friction)  # cosine of the cone's half angle
    start, inward = surface.points[chosen], -surface.normals[chosen]
    cosine, turn = np.cos(rng.uniform(0, np.arccos(least), RAYS)), rng.uniform(0, 2 * np.pi, RAYS)
    first = np.cross(inward, np.eye(3)[np.abs(inward).argmin(axis=1)])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    across = np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * np.cross(inward, first)
    ray = cosine[:, None] * inward + np.sqrt(1 - cosine**2)[:, None] * across
    normals = rays.normals / np.linalg.norm(rays.normals, axis=1, keepdims=True)
    lengths, cosines = np.full((2, RAYS, CROSSINGS + 1), np.inf)  # where each ray meets a face, and under which angle
    along, alive = np.full(RAYS, STEP), np.flatnonzero(~rays.blocked(start - STEP * ray, -ray, CLEARANCE))
    for number in range(CROSSINGS):
        face = rays.first_face(start[alive] + along[alive, None] * ray[alive], ray[alive], widest + CLEARANCE)
        alive, face = alive[face >= 0], face[face >= 0]
        cosines[alive, number] = slope = np.einsum("ni,ni->n", normals[face], ray[alive])
        with np.errstate(divide="ignore", invalid="ignore"):  # faces seen edge-on
            length = np.einsum("ni,ni->n", normals[face], rays.triangles[face, 0] - start[alive]) / slope
        lengths[alive, number] = along[alive] = np.fmax(along[alive], length) + STEP
    within = (lengths >= NARROWEST) & (lengths <= widest) & (cosines >= least) & (cosines <= 1 + 1e-9)
    within[:, :-1] &= lengths[:, 1:] > lengths[:, :-1] + CLEARANCE  # room for a finger
    ray_of, crossing = np.nonzero(within)
    ends = start[ray_of] + lengths[ray_of, crossing, None] * ray[ray_of]
    return np.stack([start[ray_of], ends], axis=1)


def sides_of(hand: Hand) -> np.ndarray:
    """The side (s,) of each sensor: 1 for those that the hand's file says oppose the others, or else the thumb's, or
    else, of the open hand's gels, those on the first one's side of the widest gap; -1 for others. One alone has 0."""
    first = hand.sensor_thumb if hand.opposing_sensors is None else hand.opposing_sensors
    if len(first) == 1:
        return np.zeros(1, dtype=int)
    if not first.any():
        place = hand.sensor_frames(hand.forward(np.eye(4), hand.open_joint_positions))[0]
        along = (place - place.mean(axis=0)) @ np.linalg.svd(place - place.mean(axis=0))[2][0]
        ordered = np.sort(along)
        first = along > ordered[np.diff(ordered).argmax()]
        first = first == first[0]
    return np.where(first, 1, -1)


class Oppositions:
    """Ways in which a hand's fingers oppose each other, in the palm's frame: K of them, by falling width.

    Attributes: sides (s,); main, the sensor of side -1 and that of side 1 that are aimed at a pair; joints (K, J);
    apex (K, 2, 3) of the main gels, and width (K,) between them. K is 0 for a hand that can't pinch.
    """

    def __init__(self, workspace: Workspace, rng: np.random.Generator):
        hand, self.sides = workspace.hand, sides_of(workspace.hand)
        self.workspace, self.main = workspace, np.zeros(2, dtype=int)
        self.joints, self.apex, self.width = np.zeros((0, len(hand.joint_link))), np.zeros((0, 2, 3)), np.zeros(0)
        if not self.sides.any():
            return
        for number, side in enumerate((-1, 1)):  # the middle one
            mine = np.flatnonzero(self.sides == side)
            away = np.linalg.norm(workspace.open_apex[mine] - workspace.open_apex[mine].mean(axis=0), axis=1)
            self.main[number] = mine[away.argmin()]
        own = workspace.moves[self.main]
        drawn = rng.integers(len(workspace.configurations), size=(2, DRAWN))
        drawn[1] = drawn[0] if (own[0] & own[1]).any() else drawn[1]
        apex, direction = workspace.apex(hand.forward(np.eye(4), workspace.configurations))
        ends = np.stack([apex[drawn[k], self.main[k]] for k in (0, 1)], axis=1)
        facing = np.stack([direction[drawn[k], self.main[k]] for k in (0, 1)], axis=1)
        between = ends[:, 1] - ends[:, 0]
        width = np.linalg.norm(between, axis=1)
        cosine = np.einsum("nki,ni->nk", facing, between) * [1, -1] / np.maximum(width, 1e-9)[:, None]
        good = np.flatnonzero((cosine >= FACING).all(axis=1))
        good = good[np.argsort(width[good], kind="stable")][:: max(1, len(good) // KEPT)]
        self.joints = np.tile(hand.open_joint_positions, (len(good), 1))
        for k in (0, 1):
            self.joints[:, own[k]] = workspace.configurations[drawn[k, good]][:, own[k]]
        self.apex, self.width = ends[good], width[good]

    def placement(
        self, pair: np.ndarray, axis: np.ndarray, surface: Surface, rng: np.random.Generator
    ) -> Placement | None:
        """A hand about a pair of points (2, 3): the main gels `CLEARANCE` off them along `axis`, which goes from the
        first to the second, turned about it at random; None if the hand can't reach so."""
        width, workspace = np.linalg.norm(pair[1] - pair[0]), self.workspace
        near = np.argsort(np.abs(self.width - width - 2 * CLEARANCE), kind="stable")[: 8 * TRIED]
        chosen = rng.permutation(near)[:TRIED]
        turn, along = rng.uniform(0, 2 * np.pi, len(chosen)), self.apex[chosen, 1] - self.apex[chosen, 0]
        rotation = rotation_about(axis, turn) @ least_rotation(along / self.width[chosen, None], axis)
        centre = (rotation @ self.apex[chosen].mean(axis=1)[..., None])[..., 0]
        pose = np.tile(np.eye(4), (len(chosen), 1, 1))
        pose[:, :3, :3], pose[:, :3, 3] = rotation, pair.mean(axis=0) - centre

        inward = np.stack([axis, -axis]) @ rotation  # of the main gels, in the palm's frame
        ends = (pair - pose[:, None, :3, 3]) @ rotation
        start, off = self.reach(self.joints[chosen], self.main, ends - CLEARANCE * inward, inward)
        missed = np.linalg.norm(off, axis=-1).max(axis=-1)
        missed[np.linalg.norm(off[..., :3], axis=-1).max(axis=-1) > MISSED] = np.inf
        best = int(missed.argmin())
        if missed[best] == np.inf:
            return None
        sensors, goals, directions = self.main.tolist(), [*ends[best]], [*inward[best]]
        own = (surface.points - pose[best, :3, 3]) @ rotation[best]
        for sensor in np.setdiff1d(np.flatnonzero(self.sides), self.main).tolist():
            # Beside the main gel of its side, as far as in the open hand, where the surface faces it.
            k = int(self.sides[sensor] > 0)
            place = ends[best, k] + workspace.open_apex[sensor] - workspace.open_apex[self.main[k]]
            away = np.linalg.norm(own - place, axis=1)
            away[-(surface.normals @ rotation[best]) @ inward[best, k] < BESIDE_FACING] = np.inf
            if away.min() < BESIDE:
                sensors.append(sensor)
                goals.append(own[away.argmin()])
                directions.append(inward[best, k])
        way = np.array(directions) * np.array([-CLEARANCE, PRESS])[:, None, None]
        (joints, targets), _ = self.reach(
            np.tile(start[best], (2, 1)), np.array(sensors), np.array(goals) + way, np.array(directions)
        )
        sides = np.where(np.isin(np.arange(len(self.sides)), sensors), self.sides, 0)
        return Placement(pose[best], joints, targets, sides)

    def reach(
        self, joints: np.ndarray, sensors: np.ndarray, goal: np.ndarray, inward: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Inverse kinematics of some sensors at once, within the joints' ranges, in the palm's frame.

        joints: (n, J) to start from; goal, inward: (n, t, 3), or (t, 3), where the gels of `sensors` (t,) shall be and
        look. Returns joint positions (n, J), and by how much each gel is off (n, t, 6): its place, m, and its
        direction, by `DIRECTION_LENGTH`.
        """
        workspace, hand = self.workspace, self.workspace.hand
        goals = np.zeros((len(joints), len(hand.sensor_link), 3)), np.zeros((len(joints), len(hand.sensor_link), 3))
        goals[0][:, sensors], goals[1][:, sensors] = goal, inward
        best, least, off = joints, np.full(len(joints), np.inf), np.zeros((len(joints), len(sensors), 6))
        for _ in range(ITERATIONS):
            error, jacobian = workspace._linearised(joints, *goals)
            error = error[:, sensors]
            missed = np.linalg.norm(error, axis=-1).max(axis=-1)
            better = missed < least
            if (missed > CONVERGED * least).all():
                break
            best, off = np.where(better[:, None], joints, best), np.where(better[:, None, None], error, off)
            least = np.minimum(least, missed)
            error, rows = error.reshape(len(joints), -1), jacobian[:, sensors]
            rows = rows.reshape(*error.shape, -1)[..., hand.drivers]
            transposed = np.swapaxes(rows, -1, -2)
            square = transposed @ rows + DAMPING * np.eye(len(hand.drivers))
            step = solve_positive_definite(square, (transposed @ error[..., None])[..., 0])
            joints = joints.copy()
            joints[:, hand.drivers] += step
            joints = hand.follow(np.clip(joints, *hand.joint_range.T))
        return best, off


def least_rotation(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Rotations (n, 3, 3) that take unit vectors `start` (n, 3) to `end` (3,), by the least angle."""
    axis, cosine = np.cross(start, end), start @ end
    length = np.linalg.norm(axis, axis=1)
    aside = np.cross(start, np.eye(3)[np.abs(start).argmin(axis=1)])  # where they are opposite or the same
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    axis = np.where(length[:, None] > 1e-9, axis / np.maximum(length, 1e-12)[:, None], aside)
    return rotation_about(axis, np.arctan2(length, cosine))


@lru_cache(maxsize=1)
def oppositions_of(workspace: Workspace) -> Oppositions:
    """The hand's ways of opposing, made once a process."""
    return Oppositions(workspace, np.random.default_rng(0))
