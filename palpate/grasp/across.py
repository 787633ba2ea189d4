"""Grasps across an object: the hand is placed about two opposing surface points, closes with friction and a grip, and
is kept if it holds the object."""

from collections.abc import Callable, Mapping
from functools import cached_property, lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

from palpate.batch import UnusableObject
from palpate.grasp.antipodal import Oppositions, Placement, opposing_points, oppositions, place
from palpate.grasp.contacts import Contacts, on_object
from palpate.grasp.grasp import BLOCKED, ONE_SIDE, Grasp, Grasper
from palpate.grasp.gripping import GripSimulation
from palpate.grasp.hold import DIRECTIONS, GRAVITY, HoldSimulation, body_of
from palpate.grasp.targets import Workspace
from palpate.mesh import OBJECT_POSITION
from palpate.surface.embree import RayMesh

PLACEMENTS = 50  # pairs and placements for one attempt
LEAST_FORCE = 0.05  # of the grip, of the sensors of each side: with less they don't press


class HoldTest(NamedTuple):
    """What `palpate.grasp.hold_grasps` tests: keys of the config's `hold`."""

    friction: float
    density: float  # kg / m^3
    distance: float  # m
    duration: float  # s


class HoldingGrasper(Grasper):
    """A `Grasper` that keeps grasps that hold only."""

    def __init__(self, *args: Any, test: HoldTest, only_held: bool = True, **kwargs: Any):
        """test: which grasps hold. only_held: whether others are not kept. Others as for `Grasper`."""
        self.test, self.only_held = test, only_held
        super().__init__(*args, **kwargs)

    def loose(self, simulation: Callable[..., Any] = HoldSimulation) -> Any:
        """A simulation of the object with its mass and friction."""
        body = body_of(self.collision, self.test.density)
        return simulation(self.hand, self.patches, body, self.test.friction, self.timestep)

    @cached_property
    def loose_simulation(self) -> HoldSimulation:
        """As `Grasper.loose_simulation`."""
        return self.loose()

    def holds(self, pose: np.ndarray, joint_positions: np.ndarray) -> bool:
        """As `Grasper.holds`; the test ends with the first direction along which the object is lost."""
        in_world = pose.copy()
        in_world[:3, 3] = pose[:3, 3] + OBJECT_POSITION - OBJECT_POSITION  # rounded as `hold_grasps` will have it
        at_rest, limits = (in_world, joint_positions, self.servo_positions()), (self.test.duration, self.test.distance)
        return not self.only_held or all(
            self.loose_simulation.moved(*at_rest, GRAVITY * axis, *limits) <= self.test.distance for axis in DIRECTIONS
        )

    def servo_positions(self) -> np.ndarray:
        """The servos' present targets (J,); those of coupled joints follow."""
        positions = np.zeros(len(self.hand.joint_link))
        positions[self.hand.drivers] = self.simulation.data.ctrl
        return self.hand.follow(positions)


class AntipodalGrasper(HoldingGrasper):
    """A `Grasper` that places the hand across the object, and closes it with a grip.

    A grasp's `more` are the arrays that the contract has for such grasps.
    """

    simulation: GripSimulation

    def __init__(self, *args: Any, grip: float, is_loose: bool = True, **kwargs: Any):
        """grip: N with which each side of the hand presses. is_loose: whether the object moves while the hand closes.
        Raises UnusableObject for a hand whose fingers can't oppose each other."""
        self.grip, self.is_loose = grip, is_loose
        super().__init__(*args, **kwargs)
        self.rays, self.oppositions = RayMesh(self.visual), oppositions_of(self.workspace)
        if not len(self.oppositions.joints):
            raise UnusableObject(f"no two fingers of hand {self.hand.name!r} oppose each other: name them (`opposes`)")

    def simulate(self) -> GripSimulation:
        """As `Grasper.simulate`."""
        return self.loose(partial(GripSimulation, grip=self.grip, loose=self.is_loose))

    @cached_property
    def loose_simulation(self) -> GripSimulation:
        """As `Grasper.loose_simulation`."""
        return self.simulation if self.is_loose else self.loose(partial(GripSimulation, grip=self.grip))

    def attempt(self, rng: np.random.Generator) -> Grasp | str:
        """As `Grasper.attempt`."""
        placed = self.across(rng)
        return BLOCKED if placed is None else self.closed_at(placed.pose, placed.targets)

    def across(self, rng: np.random.Generator) -> Placement | None:
        """A placement about a random pair of points at which the hand is clear of the object, if one is found; the
        simulation is put there."""
        tried, widest = 0, float(self.oppositions.width.max())
        for _ in range(PLACEMENTS):
            pairs = opposing_points(self.surface, self.rays, self.test.friction, widest, rng)
            for pair in pairs[: PLACEMENTS - tried]:
                tried += 1
                placed = place(self.workspace, self.oppositions, pair, self.surface, rng)
                if placed is not None and self.is_free(placed):
                    return placed
        return None

    def is_free(self, placed: Placement) -> bool:
        """Whether the hand is clear of the object and of itself; the simulation is put there."""
        self.placed, self.simulation.sides = placed, placed.sides
        self.simulation.place(placed.pose, placed.joints)
        links = self.hand.forward(placed.pose, placed.joints)
        clear = not self.simulation.in_contact() and not self.check.in_object(links)
        return clear and self.check.in_itself(links) <= self.max_penetration

    def at_rest(self, touching: Contacts) -> dict[str, np.ndarray] | str:
        """As `Grasper.at_rest`: how the closing began, where the servos are, and the forces on the object."""
        placed, pressed = self.placed, on_object(touching)
        force = (pressed.force * (pressed.link == self.hand.sensor_link[:, None])).sum(axis=1)
        if min(force[placed.sides == side].sum() for side in (-1, 1)) < LEAST_FORCE * self.grip:
            return ONE_SIDE
        start = {"start_pose": placed.pose, "start_positions": placed.joints, "target_positions": placed.targets}
        servos = {"servo_positions": self.servo_positions(), "sensor_force": force}
        return start | servos | {"sensor_side": placed.sides}


@lru_cache(maxsize=1)
def oppositions_of(workspace: Workspace) -> Oppositions:
    """The hand's ways of opposing, made once a process."""
    return oppositions(workspace, np.random.default_rng(0))


def grasper_type(grasps: Mapping[str, Any], hold: Mapping[str, Any]) -> Callable[..., Grasper]:
    """What makes the graspers of a config's `grasps` and `hold`; arguments of the result as for `Grasper`."""
    only_held = grasps["keep"] == "hold"
    if grasps["placement"] == "surface" and not only_held:
        return Grasper
    test = HoldTest(*(hold[key] for key in HoldTest._fields))
    if grasps["placement"] == "antipodal":
        loose = grasps["object"] == "loose"
        return partial(AntipodalGrasper, test=test, only_held=only_held, grip=grasps["grip"], is_loose=loose)
    return partial(HoldingGrasper, test=test)
