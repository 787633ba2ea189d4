"""An object's kept grasps, made again: frames of the closing hand from open to rest, and whether the grasps hold. A
closing depends on the palm's pose and the servos' targets only: placements are drawn again with the grasps' generator,
and kept ones simulated. Omitted are the other closings, and all checks of touch and penetration."""

from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from palpate.grasp.contacts import SLOTS, cone_margin, contact_arrays, contacts, wrench_radius
from palpate.grasp.grasp import Grasper
from palpate.grasp.hold import DIRECTIONS
from palpate.mesh import OBJECT_POSITION
from palpate.seal import DamagedFile

# Of what every frame has, in the order in which `closing_frames` makes it.
NAMES = ("time", "joint_positions", "joint_velocities", "link_pose", "sensor_position", "sensor_rotation")
DIFFERS = (
    "closing again does not give the stored grasps bit for bit: they were made with another version of an engine, "
    "or on another kind of processor; "
)


def frame_steps(count: int, steps: int) -> np.ndarray:
    """Steps of a closing of `steps` time steps at which its `count` frames are: evenly in time, the last at rest, and
    the first the open hand, 0, unless there is only one. Raises ValueError for more frames than states."""
    if count > steps + 1:
        raise ValueError(f"frames: {count} moments of a closing of {steps} time steps: ask for at most {steps + 1}")
    return np.rint(np.linspace(steps, 0, count)).astype(int)[::-1]


def kept_closings(
    grasper: Grasper, kept: Mapping[str, np.ndarray], rng: np.random.Generator, remedy: str = ""
) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """The closings of g kept grasps, as they were tried: number, palm pose (4, 4) in the object's own frame, at which
    the open hand is placed, servos' targets (J,). Arguments and errors as for `closing_frames`."""
    if "start_pose" in kept:
        for number, (pose, targets) in enumerate(zip(kept["start_pose"], kept["target_positions"], strict=True)):
            grasper.simulation.sides = kept["sensor_side"][number]
            grasper.simulation.place(pose, kept["start_positions"][number])
            yield number, pose, targets
        return
    palms, drawn_again = kept["palm_pose"], 0
    for _ in range(int(kept["attempts"])):
        if drawn_again == len(palms) or (placed := grasper.placement(rng)) is None:
            continue
        pose, thumb = placed
        in_world = pose.copy()
        in_world[:3, 3] += OBJECT_POSITION
        for number in np.flatnonzero((palms == in_world).all(axis=(1, 2))):
            drawn_again += 1
            yield int(number), pose, grasper.workspace.targets(pose, grasper.surface, thumb)
    if drawn_again < len(palms):
        raise DamagedFile(DIFFERS + remedy)


def closing_frames(
    grasper: Grasper,
    kept: Mapping[str, np.ndarray],
    rng: np.random.Generator,
    count: int,
    remedy: str = "",
    with_contacts: bool = False,
) -> dict[str, np.ndarray]:
    """The frames of an object's g kept grasps, by the contract's names: (g, f, ...), world frame. kept: the object's
    row of the grasps store. rng: as given to `grasp_object`. with_contacts: also `palpate.grasp.contacts` of each. The
    last of the `count` frames equals the grasp bit for bit; raises DamagedFile, with the remedy, if it does not
    (another version, or another kind of processor), ValueError as `frame_steps` does."""
    simulation, hand = grasper.simulation, grasper.hand
    steps = frame_steps(count, simulation.steps)
    time = steps * simulation.model.opt.timestep
    records = {}
    for number, pose, targets in kept_closings(grasper, kept, rng, remedy):
        states, poses, touching = [], [], []
        for _ in simulation.frames(targets, set(steps.tolist())):
            states.append(simulation.joint_state)
            poses.append(simulation.seen_from_object(pose))
            touching += [contacts(simulation)] if with_contacts else []
        joints, velocities = map(np.array, zip(*states, strict=True))
        links = hand.forward(np.array(poses), joints)
        position, rotation = hand.sensor_frames(links)
        records[number] = dict(zip(NAMES, (time, joints, velocities, links, position, rotation), strict=True))
        if with_contacts:
            records[number] |= contact_arrays(touching, hand.sensor_link, position, rotation)
    frames = {name: np.stack([records[number][name] for number in sorted(records)]) for name in records[0]}
    for places in (frames["link_pose"][..., :3, 3], frames["sensor_position"]):
        places += OBJECT_POSITION
    if with_contacts:  # slots without a contact stay 0
        taken = np.arange(SLOTS) < frames["contact_count"][..., None]
        frames["contact_position"] += taken[..., None] * np.array(OBJECT_POSITION)
    if any((frames[name][:, -1] != kept[name]).any() for name in NAMES if name in kept):
        raise DamagedFile(DIFFERS + remedy)
    return frames


def hold_grasps(
    grasper: Grasper, kept: Mapping[str, np.ndarray], rng: np.random.Generator, remedy: str = ""
) -> dict[str, np.ndarray]:
    """Whether each of g kept grasps holds its object, by the contract's names: whether it stays within the distance of
    the grasper's `hold` for its duration. A direction's simulation ends at the distance. Arguments and errors as for
    `kept_closings`."""
    simulation, hold = grasper.loose_simulation, grasper.hold
    body, count = simulation.body, len(kept["palm_pose"])
    length = np.linalg.norm(grasper.collision.vertices - body.centre, axis=1).max()
    moved, (radius, margin) = np.full((count, len(DIRECTIONS)), np.nan), np.zeros((2, count))
    if "servo_positions" in kept:
        poses = kept["palm_pose"].copy()
        poses[:, :3, 3] -= OBJECT_POSITION
        closed: Iterable = zip(range(count), poses, kept["servo_positions"], strict=True)
    else:
        closed = kept_closings(grasper, kept, rng, remedy)
    for number, pose, targets in closed:
        at_rest = pose, kept["joint_positions"][number], targets
        moved[number] = [*grasper.moved(*at_rest)]
        pressed = simulation.pressed(*at_rest)
        radius[number] = wrench_radius(pressed, hold["friction"], body.centre, length)
        margin[number] = cone_margin(pressed, hold["friction"])
    simulated = ~np.isnan(moved)
    held = np.where(simulated, moved <= hold["distance"], -1)
    return {
        "held": np.where(simulated.all(axis=1), held.min(axis=1), -1),
        "held_along": held,
        "moved": np.where(simulated, moved, np.inf),
        "mass": np.array(simulation.model.body("object").mass[0] / simulation.heavier),
        "solid": np.array(body.solid),
        "wrench_radius": radius,
        "cone_margin": margin,
    }
