"""Grasps of one object: attempts until enough are valid, then the selection."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import trimesh

from palpate.catalogue.batch import Unusable
from palpate.grasp.closing import TIMESTEP, GraspScene
from palpate.grasp.patches import surface_patches
from palpate.grasp.penetration import PenetrationCheck
from palpate.grasp.placement import palm_pose, with_normals
from palpate.grasp.targets import Workspace
from palpate.hand import Hand
from palpate.mesh import OBJECT_POSITION
from palpate.touch import RayCaster

MAX_PLACEMENTS = 50  # palm poses looked at for one attempt


@dataclass(frozen=True)
class GraspSet:
    """The selected grasps of one object, best first; world frame, metres, radians."""

    joint_positions: np.ndarray  # (g, J)
    palm_pose: np.ndarray  # (g, 4, 4)
    link_pose: np.ndarray  # (g, L, 4, 4)
    sensor_position: np.ndarray  # (g, 4, 3)
    sensor_rotation: np.ndarray  # (g, 4, 3, 3)
    touches: np.ndarray  # (g, 4) bool
    penetration: np.ndarray  # (g,) float32, the hand in the object or in itself
    attempts: int  # grasps simulated
    discarded: dict  # of them, by reason


def grasp_object(
    visual: trimesh.Trimesh,
    collision: trimesh.Trimesh,
    surface_points: np.ndarray,
    hand: Hand,
    rng: np.random.Generator,
    per_object: int = 5,
    attempts: int = 6,
    max_attempts: int = 60,
    timestep: float = TIMESTEP,
    max_penetration: float = 0.001,
) -> GraspSet:
    offset = np.array(OBJECT_POSITION)
    workspace = workspace_of(id(hand), hand)
    surface = with_normals(surface_points[:4000] - offset, visual)
    scene = GraspScene(hand, surface_patches(collision), timestep)
    check = PenetrationCheck(hand, visual)
    caster = RayCaster(visual)
    counts = {"placement": 0, "unstable": 0, "untouched": 0, "penetrating": 0}
    valid = []
    tried = 0
    while tried < max_attempts and len(valid) < attempts:
        tried += 1
        pose = free_palm_pose(hand, surface, scene, check, rng)
        if pose is None:
            counts["placement"] += 1
            continue
        closed = scene.close(workspace.targets(pose, surface))
        if not closed.finite:
            counts["unstable"] += 1
            continue
        links = hand.forward(pose, closed.joint_positions)
        position, rotation = hand.sensor_frames(links)
        touches = caster.succeeds(position, rotation)
        if not touches.any():
            counts["untouched"] += 1
            continue
        depth = max(check.in_object(links), check.in_itself(links))
        if depth > max_penetration:
            counts["penetrating"] += 1
            continue
        valid.append((closed.joint_positions, pose, links, position, rotation, touches, depth))
    if len(valid) < per_object:
        raise Unusable(f"{len(valid)} of {per_object} grasps in {tried} attempts: {counts}")
    order = np.argsort([-v[5].sum() for v in valid], kind="stable")[:per_object]
    stack = [np.stack([np.asarray(valid[i][k]) for i in order]) for k in range(7)]
    stack[1][:, :3, 3] += offset
    stack[2][..., :3, 3] += offset
    stack[3] += offset
    return GraspSet(*stack[:6], stack[6].astype(np.float32), tried, counts)


@lru_cache(maxsize=2)
def workspace_of(_, hand):
    return Workspace(hand, np.random.default_rng(0))


def free_palm_pose(hand, surface, scene, check, rng):
    for _ in range(MAX_PLACEMENTS):
        pose = palm_pose(hand, surface, rng)
        scene.place(pose, hand.open_joint_positions)
        if scene.in_contact():
            continue
        if check.in_object(hand.forward(pose, hand.open_joint_positions)) > 0:
            continue
        return pose
    return None
