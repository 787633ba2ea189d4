"""Where a grasp goes: the palm at a random surface point; for each sensor a surface point, by inverse kinematics."""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from palpate.hand import Hand
from palpate.touch.presses import tangents

GAP = (0.005, 0.060)  # metres between the palm's face and the surface
PRESS = 0.003  # metres that the gel's apex aims below the surface
DIRECTION_LENGTH = 0.03  # metres that a unit of difference in direction counts for: 30 degrees count as 15 mm
CONFIGURATIONS = 3000  # random joint positions that sample a finger's workspace
NEAREST = 64  # surface points nearest to the open finger's gel, from which it chooses
CANDIDATES = 4  # of these points, how many inverse kinematics tries
ITERATIONS = 5
DAMPING = 1e-3  # m^2, of the first step
DAMPING_FACTOR = 4.0  # divides the damping after a step that gains, multiplies it after one that doesn't


class Surface(NamedTuple):
    """Exterior surface points and their outward unit normals, both (N, 3)."""

    points: np.ndarray
    normals: np.ndarray


def palm_pose(hand: Hand, surface: Surface, rng: np.random.Generator) -> np.ndarray:
    """A palm pose (4, 4): at a random point, the palm's normal into the surface, random turn and gap."""
    chosen = rng.integers(len(surface.points))
    turn, gap = rng.uniform(0, 2 * np.pi), rng.uniform(*GAP)
    face, inward = np.eye(4), -surface.normals[chosen]
    first, second = tangents(inward)
    along = np.cos(turn) * first + np.sin(turn) * second
    face[:3, :3] = np.column_stack([inward, np.cross(along, inward), along])
    face[:3, 3] = surface.points[chosen] - gap * inward
    return face @ np.linalg.inv(hand.palm_anchor)


class Workspace:
    """Reachable positions and directions of a hand's sensors, in the palm frame; the same for every object."""

    def __init__(self, hand: Hand):
        self.hand, rng = hand, np.random.default_rng(0)
        self.contact_distance = hand.contact_distance()
        self.chains = sensor_joints(hand)
        # Also those that joints of the chain drive or follow: (s, J) bool.
        self.moves = self.chains @ (hand.joint_driver[:, None] == hand.joint_driver)
        low, high = hand.joint_range.T
        self.configurations = hand.follow(rng.uniform(low, high, (CONFIGURATIONS, len(low))))
        apex, direction = self.apex(hand.forward(np.eye(4), self.configurations))
        features = np.concatenate([apex, DIRECTION_LENGTH * direction], axis=-1)
        self.open_apex = self.apex(hand.forward(np.eye(4), hand.open_joint_positions))[0]
        self.trees = [cKDTree(features[:, sensor]) for sensor in range(len(hand.sensor_link))]

    def apex(self, link_pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions and directions of the gels, (..., s, 3) each, for link poses (..., L, 4, 4)."""
        position, rotation = self.hand.sensor_frames(link_pose)
        direction = rotation[..., 0]
        return position + self.contact_distance[:, None] * direction, direction

    def targets(self, palm_pose: np.ndarray, surface: Surface, thumb: bool = True) -> np.ndarray:
        """Joint positions (J,) at which each gel is pressed into a surface point that it faces, or nearly so: of those
        near its open gel the one that it comes nearest to, even if out of reach, for contact stops the finger.
        palm_pose: (4, 4) in the surface's frame. thumb: whether the fingers of `sensor_thumb` close too."""
        hand = self.hand
        points = (surface.points - palm_pose[:3, 3]) @ palm_pose[:3, :3]
        normals = surface.normals @ palm_pose[:3, :3]
        goals = points - PRESS * normals
        features = np.concatenate([goals, -DIRECTION_LENGTH * normals], axis=1)
        chosen_points = np.empty((CANDIDATES, len(self.trees)), dtype=int)
        joints = np.tile(hand.open_joint_positions, (CANDIDATES, 1))
        for sensor, tree in enumerate(self.trees):
            away = np.linalg.norm(goals - self.open_apex[sensor], axis=1)
            near = np.argsort(away, kind="stable")[:NEAREST]
            miss, configuration = tree.query(features[near])
            best = np.resize(np.argsort(miss + away[near], kind="stable"), CANDIDATES)
            chosen_points[:, sensor] = near[best]
            moved = self.moves[sensor]
            joints[:, moved] = self.configurations[configuration[best]][:, moved]
        joints, miss = self.solve(joints, goals[chosen_points], -normals[chosen_points])

        targets = hand.open_joint_positions.copy()
        for sensor in np.flatnonzero(thumb | ~hand.sensor_thumb):
            moved = self.moves[sensor]
            targets[moved] = joints[miss[:, sensor].argmin(), moved]
        return targets

    def solve(self, joints: np.ndarray, goal: np.ndarray, inward: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Inverse kinematics by Levenberg-Marquardt, within the joints' ranges, in the palm frame. joints: (..., J) to
        start from; goal, inward: (..., s, 3) where each gel shall be and look. Returns joint positions (..., J) and how
        far each gel is off (..., s), metres, with directions weighted by `DIRECTION_LENGTH`."""
        low, high = self.hand.joint_range.T
        damping = np.full(goal.shape[:-1], DAMPING)
        error, jacobian = self.linearised(joints, goal, inward)
        miss = np.linalg.norm(error, axis=-1)
        for _ in range(ITERATIONS):
            transposed = np.swapaxes(jacobian, -1, -2)
            square = jacobian @ transposed + damping[..., None, None] * np.eye(6)
            step = (transposed @ solve_positive_definite(square, error)[..., None])[..., 0]
            tried = self.hand.follow(np.clip(joints + step.sum(axis=-2), low, high))
            error_tried, jacobian_tried = self.linearised(tried, goal, inward)
            miss_tried = np.linalg.norm(error_tried, axis=-1)
            better = miss_tried < miss
            joints = np.where((better[..., None] & self.moves).any(axis=-2), tried, joints)
            error = np.where(better[..., None], error_tried, error)
            jacobian = np.where(better[..., None, None], jacobian_tried, jacobian)
            miss = np.where(better, miss_tried, miss)
            damping = np.where(better, damping / DAMPING_FACTOR, damping * DAMPING_FACTOR)
        return joints, miss

    def linearised(self, joints: np.ndarray, goal: np.ndarray, inward: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Error of each gel's place and direction (..., s, 6), and the Jacobian."""
        pose = self.hand.forward(np.eye(4), joints)
        apex, direction = self.apex(pose)
        error = np.concatenate([goal - apex, DIRECTION_LENGTH * (inward - direction)], axis=-1)
        jacobian = self.jacobian(pose, apex, direction)
        if len(self.hand.drivers) < joints.shape[-1]:
            jacobian = jacobian @ self.hand.follow_slopes(joints)[..., None, :, :]
        return error, jacobian

    def jacobian(self, pose: np.ndarray, apex: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Derivatives (..., s, 6, J) of `solve`'s place and direction of each gel by the joints, each moved alone."""
        hand = self.hand
        frames = pose[..., hand.joint_link, :, :]
        axis = (frames[..., :3, :3] @ hand.joint_axis[:, :, None])[..., None, :, :, 0]  # (..., 1, J, 3)
        arm = apex[..., :, None, :] - frames[..., None, :, :3, 3]  # (..., s, J, 3)
        slides = hand.joint_slides[:, None]
        turned = DIRECTION_LENGTH * np.cross(axis, direction[..., :, None, :])
        columns = np.concatenate([np.where(slides, axis, np.cross(axis, arm)), np.where(slides, 0, turned)], axis=-1)
        return np.swapaxes(columns * self.chains[:, :, None], -1, -2)


def solve_positive_definite(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solutions x (..., N) of matrix x = right, for symmetric positive definite matrices (..., N, N), by
    elimination, which needs no pivots here. LAPACK's result depends on its threads, and is slower for these."""
    matrix, x, size = matrix.copy(), right.copy(), matrix.shape[-1]
    for row in range(size):
        factor = matrix[..., row + 1 :, row] / matrix[..., row, row, None]
        matrix[..., row + 1 :, row:] -= factor[..., None] * matrix[..., row, None, row:]
        x[..., row + 1 :] -= factor * x[..., row, None]
    for row in reversed(range(size)):
        known = (matrix[..., row, row + 1 :] * x[..., row + 1 :]).sum(axis=-1)
        x[..., row] = (x[..., row] - known) / matrix[..., row, row]
    return x


def sensor_joints(hand: Hand) -> np.ndarray:
    """Which joints are between the palm and which sensor: (s, J) bool."""
    between = np.zeros((len(hand.sensor_link), len(hand.joint_link)), dtype=bool)
    for sensor, link in enumerate(hand.sensor_link):
        while link >= 0:
            between[sensor, hand.joint_link == link] = True
            link = hand.link_parent[link]
    return between
