"""Grasps across an object: the hand is placed about two opposing surface points, and closes with friction and a grip.
Pairs are sampled as in ACRONYM (Eppner, Mousavian, Fox 2021): from a surface point a ray goes into the object, within
the friction cone of the normal; where it leaves the object it has to be within the friction cone there."""

from collections.abc import Callable, Mapping
from functools import cached_property, lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

from palpate.batch import UnusableObject
from palpate.grasp.contacts import Contacts, on_object
from palpate.grasp.grasp import BLOCKED, ONE_SIDE, Grasp, Grasper
from palpate.grasp.hold import GripSimulation
from palpate.grasp.targets import Surface, Workspace, solve_positive_definite
from palpate.hand import Hand
from palpate.hand.hand import rotation_about
from palpate.surface.embree import RayMesh
from palpate.touch.presses import tangents

PLACEMENTS = 50  # pairs and placements for one attempt
LEAST_FORCE = 0.05  # of the grip, of the sensors of each side: with less they don't press
RAYS = 64  # traced at once
STEP = 1e-6  # m off a face, from which a ray does not meet it
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


class AntipodalGrasper(Grasper):
    """A `Grasper` that places the hand across the object, and closes it with a grip. A grasp's `more` are the arrays
    that the contract has for such grasps."""

    simulation: GripSimulation

    def __init__(self, *args: Any, grip: float, is_loose: bool = True, **kwargs: Any):
        """grip: N with which each side of the hand presses. is_loose: whether the object moves while the hand closes.
        Raises UnusableObject for a hand whose fingers can't oppose each other."""
        self.grip, self.is_loose = grip, is_loose
        super().__init__(*args, **kwargs)
        self.ways = oppositions(self.workspace)
        if not len(self.ways.joints):
            raise UnusableObject(f"no two fingers of hand {self.hand.name!r} oppose each other: name them (`opposes`)")

    def simulate(self) -> GripSimulation:
        """As `Grasper.simulate`."""
        return self.loose(GripSimulation, grip=self.grip, loose=self.is_loose)

    @cached_property
    def loose_simulation(self) -> GripSimulation:
        """As `Grasper.loose_simulation`."""
        return self.simulation if self.is_loose else self.loose(GripSimulation, grip=self.grip)

    def attempt(self, rng: np.random.Generator) -> Grasp | str:
        """As `Grasper.attempt`, about a random pair of points at which the hand is clear of the object and itself."""
        tried, widest, simulation = 0, float(self.ways.width.max()), self.simulation
        for _ in range(PLACEMENTS):
            pairs = opposing_points(self.surface, self.caster.mesh, self.hold["friction"], widest, rng)
            for pair in pairs[: PLACEMENTS - tried]:
                tried += 1
                placed = place(self.workspace, self.ways, pair, self.surface, rng)
                if placed is None:
                    continue
                self.placed, simulation.sides = placed, placed["sensor_side"]
                at_start = placed["start_pose"], placed["start_positions"]
                simulation.place(*at_start)
                links = self.hand.forward(*at_start)
                clear = not simulation.in_contact() and not self.check.in_object(links)
                if clear and self.check.in_itself(links) <= self.max_penetration:
                    return self.closed_at(placed["start_pose"], placed["target_positions"])
        return BLOCKED

    def at_rest(self, touching: Contacts) -> dict[str, np.ndarray] | str:
        """As `Grasper.at_rest`: how the closing began, where the servos are, and the forces on the object."""
        pressed, sides = on_object(touching), self.placed["sensor_side"]
        force = (pressed.force * (pressed.link == self.hand.sensor_link[:, None])).sum(axis=1)
        if min(force[sides == side].sum() for side in (-1, 1)) < LEAST_FORCE * self.grip:
            return ONE_SIDE
        return self.placed | {"servo_positions": self.servo_positions(), "sensor_force": force}


def grasper_type(grasps: Mapping[str, Any], hold: Mapping[str, Any]) -> Callable[..., Grasper]:
    """What makes the graspers of a config's `grasps` and `hold`; arguments of the result as for `Grasper`."""
    test = {"hold": hold, "only_held": grasps["keep"] == "hold"}
    if grasps["placement"] == "antipodal":
        return partial(AntipodalGrasper, grip=grasps["grip"], is_loose=grasps["object"] == "loose", **test)
    return partial(Grasper, **test)


def opposing_points(
    surface: Surface, rays: RayMesh, friction: float, widest: float, rng: np.random.Generator
) -> np.ndarray:
    """Pairs of points (P, 2, 3) of the exterior at most `widest` m apart, whose normals oppose each other within the
    friction cones, with room for a finger at both: P is 0 to some of `RAYS`."""
    chosen = rng.integers(len(surface.points), size=RAYS)
    least = 1 / np.hypot(1, friction)  # cosine of the cone's half angle
    start, inward = surface.points[chosen], -surface.normals[chosen]
    cosine, turn = np.cos(rng.uniform(0, np.arccos(least), RAYS)), rng.uniform(0, 2 * np.pi, RAYS)
    across = (np.stack([np.cos(turn), np.sin(turn)], axis=-1)[:, None] @ tangents(inward))[:, 0]
    ray = cosine[:, None] * inward + np.sqrt(1 - cosine**2)[:, None] * across
    # The last face within a reach, seen from behind it: of half of the rays the widest, so that walls don't prevail.
    reach = CLEARANCE + widest * rng.uniform(0, 2, RAYS).clip(max=1)
    face = rays.first_face(start + reach[:, None] * ray, -ray, reach.max())
    normals = rays.normals[face] / np.linalg.norm(rays.normals[face], axis=1, keepdims=True)
    slope = np.einsum("ni,ni->n", normals, ray)
    length = np.einsum("ni,ni->n", normals, rays.triangles[face, 0] - start) / np.maximum(slope, least)
    good = (face >= 0) & (slope >= least) & (length >= NARROWEST) & (length <= reach - CLEARANCE)
    good &= ~rays.blocked(start - STEP * ray, -ray, CLEARANCE)
    return np.stack([start, start + length[:, None] * ray], axis=1)[good]


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


class Oppositions(NamedTuple):
    """K ways in which two of a hand's fingers oppose each other, in the palm's frame, by rising width."""

    sides: np.ndarray  # (s,) of `sides_of`
    main: np.ndarray  # (2,) the sensors of side -1 and of side 1 that are aimed at a pair
    joints: np.ndarray  # (K, J)
    apex: np.ndarray  # (K, 2, 3) m, of the main gels
    width: np.ndarray  # (K,) m, between the main gels


@lru_cache(maxsize=1)
def oppositions(workspace: Workspace) -> Oppositions:
    """Ways of opposing among random configurations, the same in every process; none for a hand that can't pinch."""
    hand, sides, main = workspace.hand, sides_of(workspace.hand), np.zeros(2, dtype=int)
    for number, side in enumerate((-1, 1)):  # the middle one
        mine = np.flatnonzero(sides == side) if sides.any() else np.zeros(1, dtype=int)
        away = np.linalg.norm(workspace.open_apex[mine] - workspace.open_apex[mine].mean(axis=0), axis=1)
        main[number] = mine[away.argmin()]
    own = workspace.moves[main]
    drawn = np.random.default_rng(0).integers(len(workspace.configurations), size=(2, DRAWN))
    drawn[1] = drawn[0] if (own[0] & own[1]).any() else drawn[1]
    apex, direction = workspace.apex(hand.forward(np.eye(4), workspace.configurations))
    ends, facing = (np.stack([values[drawn[k], main[k]] for k in (0, 1)], axis=1) for values in (apex, direction))
    between = ends[:, 1] - ends[:, 0]
    width = np.linalg.norm(between, axis=1)
    cosine = np.einsum("nki,ni->nk", facing, between) * [1, -1] / np.maximum(width, 1e-9)[:, None]
    good = np.flatnonzero((cosine >= FACING).all(axis=1))
    good = good[np.argsort(width[good], kind="stable")][:: max(1, len(good) // KEPT)]
    joints = np.tile(hand.open_joint_positions, (len(good), 1))
    for k in (0, 1):
        joints[:, own[k]] = workspace.configurations[drawn[k, good]][:, own[k]]
    return Oppositions(sides, main, joints, ends[good], width[good])


def place(
    workspace: Workspace, ways: Oppositions, pair: np.ndarray, surface: Surface, rng: np.random.Generator
) -> dict[str, np.ndarray] | None:
    """A hand about a pair of points (2, 3): the main gels `CLEARANCE` off them along their line, turned about it at
    random; None if the hand can't reach so. In the object's frame, by the contract's names."""
    width = np.linalg.norm(pair[1] - pair[0])
    axis = (pair[1] - pair[0]) / width
    near = np.argsort(np.abs(ways.width - width - 2 * CLEARANCE), kind="stable")[: 8 * TRIED]
    chosen = rng.permutation(near)[:TRIED]
    along = (ways.apex[chosen, 1] - ways.apex[chosen, 0]) / ways.width[chosen, None]
    start, end = (np.concatenate([v[..., None, :], tangents(v)], axis=-2) for v in (along, axis))  # rows: orthonormal
    rotation = rotation_about(axis, rng.uniform(0, 2 * np.pi, len(chosen))) @ end.T @ start
    pose = np.tile(np.eye(4), (len(chosen), 1, 1))
    pose[:, :3, :3] = rotation
    pose[:, :3, 3] = pair.mean(axis=0) - (rotation @ ways.apex[chosen].mean(axis=1)[..., None])[..., 0]

    inward = np.stack([axis, -axis]) @ rotation  # of the main gels, in the palm's frame
    ends = (pair - pose[:, None, :3, 3]) @ rotation
    opened, off = reach(workspace, ways.joints[chosen], ways.main, ends - CLEARANCE * inward, inward)
    missed = np.linalg.norm(off, axis=-1).max(axis=-1)
    missed[np.linalg.norm(off[..., :3], axis=-1).max(axis=-1) > MISSED] = np.inf
    best = int(missed.argmin())
    if missed[best] == np.inf:
        return None
    sensors, goals, directions = ways.main.tolist(), [*ends[best]], [*inward[best]]
    own, normals = (surface.points - pose[best, :3, 3]) @ rotation[best], surface.normals @ rotation[best]
    for sensor in np.setdiff1d(np.flatnonzero(ways.sides), ways.main).tolist():
        # Beside the main gel of its side, as far as in the open hand, where the surface faces it.
        k = int(ways.sides[sensor] > 0)
        beside = ends[best, k] + workspace.open_apex[sensor] - workspace.open_apex[ways.main[k]]
        away = np.linalg.norm(own - beside, axis=1)
        away[-normals @ inward[best, k] < BESIDE_FACING] = np.inf
        if away.min() < BESIDE:
            sensors, goals = [*sensors, sensor], [*goals, own[away.argmin()]]
            directions.append(inward[best, k])
    goal = np.array(goals) + np.array(directions) * np.array([-CLEARANCE, PRESS])[:, None, None]
    (joints, targets), _ = reach(workspace, opened[[best, best]], np.array(sensors), goal, np.array(directions))
    start = {"start_pose": pose[best], "start_positions": joints, "target_positions": targets}
    return start | {"sensor_side": ways.sides * np.isin(np.arange(len(ways.sides)), sensors)}


def reach(
    workspace: Workspace, joints: np.ndarray, sensors: np.ndarray, goal: np.ndarray, inward: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Inverse kinematics of some sensors at once, which may share joints, within ranges, in the palm's frame. joints:
    (n, J) to start from; goal, inward: (n, t, 3), or (t, 3), where the gels of `sensors` (t,) shall be and look.
    Returns joint positions (n, J), and by how much each gel is off (n, t, 6): place, m, and direction, by
    `DIRECTION_LENGTH`."""
    hand, goals = workspace.hand, np.zeros((2, len(joints), len(workspace.hand.sensor_link), 3))
    goals[0][:, sensors], goals[1][:, sensors] = goal, inward
    best, off = joints, np.full((len(joints), len(sensors), 6), np.inf)
    for _ in range(ITERATIONS):
        error, jacobian = (values[:, sensors] for values in workspace.linearised(joints, *goals))
        missed, least = (np.linalg.norm(values, axis=-1).max(axis=-1) for values in (error, off))
        if (missed > CONVERGED * least).all():
            break
        better = missed < least
        best, off = np.where(better[:, None], joints, best), np.where(better[:, None, None], error, off)
        rows = jacobian.reshape(len(joints), error[0].size, -1)[..., hand.drivers]
        transposed = np.swapaxes(rows, -1, -2)
        square = transposed @ rows + DAMPING * np.eye(len(hand.drivers))
        step = solve_positive_definite(square, (transposed @ error.reshape(len(joints), -1, 1))[..., 0])
        joints = joints.copy()
        joints[:, hand.drivers] += step
        joints = hand.follow(np.clip(joints, *hand.joint_range.T))
    return best, off
