"""Grasps of one object: attempts until enough of them are valid, of which the best are kept."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import trimesh

from palpate.batch import UnusableObject
from palpate.configuration import ConfigError
from palpate.grasp.closing import TIMESTEP, GraspSimulation
from palpate.grasp.contacts import Contacts, contacts, pad_forces
from palpate.grasp.hold import DIRECTIONS, GRAVITY, HoldSimulation, body_of
from palpate.grasp.patches import surface_patches
from palpate.grasp.penetration import PenetrationCheck
from palpate.grasp.targets import Surface, Workspace, palm_pose
from palpate.hand import MAX_OUT_OF_RANGE, MAX_PENETRATION, Hand
from palpate.mesh import OBJECT_POSITION
from palpate.sensor import DIGIT, Sensor
from palpate.touch import RayCaster

# The workspace belongs to the hand: the same for every object and run.
workspace_of = lru_cache(maxsize=1)(Workspace)

# Share of the attempts in which the thumb closes too, calibrated to the paper's statistics (docs/evidence/grasps.md).
THUMB_SHARE = 0.15

# Reasons for which an attempt gives no grasp.
BLOCKED = "no palm pose free of the object"
UNSTABLE = "simulation warned or gave NaN"
UNSETTLED = "still moving at the end"
OUT_OF_RANGE = "a joint out of its range"
UNTOUCHED = "no sensor touches"
ONE_SIDE = "touches from one side only"
PENETRATING = "penetrates too deep"
NOT_HELD = "does not hold"


@dataclass(frozen=True)
class Grasp:
    """One closed hand, in the object's own frame, metres, radians."""

    joint_positions: np.ndarray  # (J,)
    palm_pose: np.ndarray  # (4, 4)
    link_pose: np.ndarray  # (L, 4, 4)
    sensor_position: np.ndarray  # (s, 3)
    sensor_rotation: np.ndarray  # (s, 3, 3)
    touches: np.ndarray  # (s,) bool
    penetration: float  # of the hand in the object, or in itself
    pad_force: np.ndarray  # (s,) N, of the object on each sensor's face, along its axis
    more: dict[str, np.ndarray]  # of a grasp across the object: `palpate.grasp.antipodal`


@dataclass(frozen=True)
class GraspSet(Grasp):
    """The g grasps kept of one object, those with the most touches first: arrays (g, ...) in the world frame."""

    attempts: int  # made in all
    discarded: Counter[str]  # how many of them gave no grasp, by reason
    omitted: dict[str, int]  # what the simulation omits, and how much of each

    @property
    def made(self) -> int:
        """Valid grasps, also those that don't hold."""
        return self.attempts - self.discarded.total() + self.discarded[NOT_HELD]


class Grasper:
    """One object and one hand, set up once for any number of attempts. Frames: the object's own."""

    def __init__(
        self,
        visual: trimesh.Trimesh,
        collision: trimesh.Trimesh,
        surface_points: np.ndarray,
        hand: Hand,
        timestep: float = TIMESTEP,
        max_penetration: float = MAX_PENETRATION,
        thumb_share: float = THUMB_SHARE,
        sensor: Sensor = DIGIT,
        hold: Mapping[str, float] | None = None,
        only_held: bool = False,
    ):
        """visual, collision: the object's meshes, with every face and decimated. surface_points: (N, 3) on its outside.
        timestep: s. max_penetration: m; a deeper grasp is not accepted. thumb_share: of the attempts, in which the
        thumb closes too. sensor: of the hand; they decide what touches. hold: the config's `friction`, `density`,
        `distance` and `duration`. only_held: whether others are not kept. Raises what `check_hand` does, and
        UnusableObject for an object without a face."""
        self.hand, self.max_penetration, self.thumb_share, self.timestep = hand, max_penetration, thumb_share, timestep
        self.hold, self.only_held = dict(hold or {}), only_held
        self.workspace = workspace_of(hand)
        self.collision, self.patches = collision, surface_patches(collision)
        if not self.patches:
            raise UnusableObject("the collision mesh has no surface that a finger could stop at")
        self.caster = RayCaster(visual, sensor=sensor)  # decides which sensors touch
        points = np.ascontiguousarray(surface_points[:4000], dtype=float)  # that placement and targets choose from
        self.surface = Surface(points, self.caster.mesh.normals_at(points))
        self.simulation = self.simulate()
        palm, patches = int((hand.geom_collides & (hand.geom_link == 0)).sum()), len(self.patches)
        self.omitted = {
            "visual faces": len(visual.faces),
            "pairs of palm and object": palm * patches,
            "pairs of object patches": patches * (patches - 1) // 2,
        }
        self.check = PenetrationCheck(hand, visual)
        self.check.require_open(max_penetration)

    def simulate(self) -> GraspSimulation:
        """The simulation of a closing."""
        return GraspSimulation(self.hand, self.patches, self.timestep)

    def loose(self, kind: Callable[..., Any] = HoldSimulation, **more: Any) -> Any:
        """A simulation of the object with its mass and friction."""
        body = body_of(self.collision, self.hold["density"], self.patches)
        return kind(self.hand, self.patches, body, self.hold["friction"], self.timestep, **more)

    @cached_property
    def loose_simulation(self) -> HoldSimulation:
        """In which the object is let go."""
        return self.loose()

    def moved(self, palm_pose: np.ndarray, joints: np.ndarray, targets: np.ndarray) -> Iterator[float]:
        """How far the object moves along each of `DIRECTIONS` if it is let go: m, as `HoldSimulation.moved`."""
        at_rest, limits = (palm_pose, joints, targets), (self.hold["duration"], self.hold["distance"])
        return (self.loose_simulation.moved(*at_rest, GRAVITY * axis, *limits) for axis in DIRECTIONS)

    def servo_positions(self) -> np.ndarray:
        """The servos' present targets (J,); those of coupled joints follow."""
        positions = np.zeros(len(self.hand.joint_link))
        positions[self.hand.drivers] = self.simulation.data.ctrl
        return self.hand.follow(positions)

    def at_rest(self, touching: Contacts) -> dict[str, np.ndarray] | str:
        """Further arrays of a grasp with these contacts, by name; or the reason for which the attempt fails."""
        return {}

    def attempt(self, rng: np.random.Generator) -> Grasp | str:
        """One random placement and closing: the grasp, or the reason for failing."""
        if (placed := self.placement(rng)) is None:
            return BLOCKED
        pose, thumb = placed
        return self.closed_at(pose, self.workspace.targets(pose, self.surface, thumb))

    def placement(self, rng: np.random.Generator) -> tuple[np.ndarray, bool] | None:
        """All that is random in an attempt: a free palm pose (4, 4), if one is found, and whether the thumb closes."""
        pose = self.free_palm_pose(rng)
        return None if pose is None else (pose, rng.random() < self.thumb_share)

    def closed_at(self, pose: np.ndarray, targets: np.ndarray) -> Grasp | str:
        """The grasp that closing towards `targets` (J,) gives, or the reason for failing. pose: (4, 4), at which the
        simulation has been placed."""
        closed = self.simulation.close(targets)
        if not closed.finite:
            return UNSTABLE
        if not closed.settled:
            return UNSETTLED
        if self.hand.out_of_range(closed.joint_positions) > MAX_OUT_OF_RANGE:
            return OUT_OF_RANGE
        touching = contacts(self.simulation)
        more = self.at_rest(touching)
        if isinstance(more, str):
            return more
        pose = self.simulation.seen_from_object(pose)
        links = self.hand.forward(pose, closed.joint_positions)
        position, rotation = self.hand.sensor_frames(links)
        touches = self.caster.succeeds(position, rotation)
        if not touches.any():
            return UNTOUCHED
        depth = max(self.check.in_object(links), self.check.in_itself(links))
        if depth > self.max_penetration:
            return PENETRATING
        pad_force = pad_forces(touching, self.hand.sensor_link, rotation)
        if self.only_held:
            in_world = pose.copy()
            in_world[:3, 3] = pose[:3, 3] + OBJECT_POSITION - OBJECT_POSITION  # rounded as `hold_grasps` will have it
            ways = self.moved(in_world, closed.joint_positions, self.servo_positions())
            if not all(way <= self.hold["distance"] for way in ways):  # ends with the first in which it is lost
                return NOT_HELD
        return Grasp(closed.joint_positions, pose, links, position, rotation, touches, depth, pad_force, more)

    def free_palm_pose(self, rng: np.random.Generator) -> np.ndarray | None:
        """A random palm pose (4, 4) at which the open hand is clear of the object; the simulation is put there."""
        open_hand = self.hand.open_joint_positions
        for _ in range(50):
            pose = palm_pose(self.hand, self.surface, rng)
            self.simulation.place(pose, open_hand)
            # The engine never collides two bodies that can't move, such as palm and object: these are checked here.
            if not self.simulation.in_contact() and not self.check.in_object(self.hand.forward(pose, open_hand)):
                return pose
        return None


def check_hand(hand: Hand, timestep: float = TIMESTEP, max_penetration: float = MAX_PENETRATION) -> None:
    """Raise ConfigError for a hand or settings that no object can be grasped with, as a run should before its first
    object: an open hand whose links penetrate each other, or what can't be simulated."""
    PenetrationCheck(hand, trimesh.Trimesh()).require_open(max_penetration)
    try:
        GraspSimulation(hand, [], timestep)
    except ValueError as error:
        raise ConfigError(f"hand {hand.name!r}: {error}") from None


def grasp_object(
    visual: trimesh.Trimesh,
    collision: trimesh.Trimesh,
    surface_points: np.ndarray,
    hand: Hand,
    rng: np.random.Generator,
    per_object: int = 5,
    attempts: int = 5,
    max_attempts: int = 60,
    grasper_type: Callable[..., Grasper] = Grasper,
    **options: Any,
) -> GraspSet:
    """Grasp an object: `attempts` grasps with a touch are made, of at most `max_attempts` attempts in all, and the
    `per_object` with the most touches kept, of equals the earlier. surface_points: (N, 3) in the world frame.
    grasper_type: makes the grasper (`palpate.grasp.grasper_type`), with the options. Returns the grasps in the world
    frame; the same generator gives the same. Raises `UnusableObject` for too few valid grasps or no surface; ValueError
    for settings, a hand or points that can't be used."""
    if attempts < per_object:
        raise ValueError(f"grasps: attempts ({attempts}) must be at least per_object ({per_object})")
    own_points = np.asarray(surface_points, dtype=float) - OBJECT_POSITION
    if np.abs(own_points - visual.bounds.mean(axis=0)).max() > visual.extents.max():
        raise ValueError(f"surface points are far from the object at {OBJECT_POSITION}: give them in the world frame")
    grasper = grasper_type(visual, collision, own_points, hand, **options)
    grasps: list[Grasp] = []
    discarded: Counter[str] = Counter()
    while len(grasps) < attempts and len(grasps) + discarded.total() < max_attempts:
        result = grasper.attempt(rng)
        if isinstance(result, str):
            discarded[result] += 1
        else:
            grasps.append(result)
    if len(grasps) < per_object:
        reasons = ", ".join(f"{reason}: {count}" for reason, count in sorted(discarded.items()))
        raise UnusableObject(f"{len(grasps)} of {per_object} grasps found in {max_attempts} attempts ({reasons})")
    best = sorted(grasps, key=lambda grasp: -grasp.touches.sum())[:per_object]
    names = [field.name for field in fields(Grasp) if field.name != "more"]
    arrays: dict[str, Any] = {name: np.stack([getattr(grasp, name) for grasp in best]) for name in names}
    for places in (arrays["palm_pose"][:, :3, 3], arrays["link_pose"][:, :, :3, 3], arrays["sensor_position"]):
        places += OBJECT_POSITION
    arrays["penetration"] = arrays["penetration"].astype(np.float32)
    arrays["more"] = {name: np.stack([grasp.more[name] for grasp in best]) for name in best[0].more}
    return GraspSet(**arrays, attempts=len(grasps) + discarded.total(), discarded=discarded, omitted=grasper.omitted)
