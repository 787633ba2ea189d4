"""Frames of an object's grasps: the closing hand at moments from open to rest.

A closing depends on the palm's pose and the servos' targets only. So placements are drawn again with the grasps'
generator, and the closings of those that were kept are simulated again. Omitted are the closings that gave no kept
grasp, and all checks of touch and penetration.
"""

from collections.abc import Mapping

import numpy as np

from palpate.checksums import DamagedFile
from palpate.grasp.grasp import Grasper
from palpate.mesh import OBJECT_POSITION


def frame_steps(count: int, steps: int) -> np.ndarray:
    """Steps of a closing of `steps` time steps at which its `count` frames are: evenly in time, the last at rest.

    The first is the open hand, 0, unless there is only one. Raises ValueError for more frames than states.
    """
    if count > steps + 1:
        raise ValueError(f"frames: {count} moments of a closing of {steps} time steps: ask for at most {steps + 1}")
    return np.rint(np.linspace(steps, 0, count)).astype(int)[::-1]


def closing_frames(
    grasper: Grasper, kept: Mapping[str, np.ndarray], rng: np.random.Generator, count: int, remedy: str = ""
) -> dict[str, np.ndarray]:
    """The frames of an object's g kept grasps, by the names that the contract has for them: (g, f, ...), world frame.

    grasper: as for the grasps. kept: the object's row of the grasps store. rng: as given to `grasp_object`. The last of
    the `count` frames equals the grasp bit for bit. Raises DamagedFile, with the remedy, if it does not: the grasps
    were made with another version or on another kind of processor; ValueError as `frame_steps` does.
    """
    simulation, hand = grasper.simulation, grasper.hand
    steps = frame_steps(count, simulation.steps)
    time = steps * simulation.model.opt.timestep
    palms, records = kept["palm_pose"], {}
    for _ in range(int(kept["attempts"])):
        if len(records) == len(palms) or (placed := grasper.placement(rng)) is None:
            continue
        pose, thumb = placed
        in_world = pose.copy()
        in_world[:3, 3] += OBJECT_POSITION
        for number in np.flatnonzero((palms == in_world).all(axis=(1, 2))):
            targets = grasper.workspace.targets(pose, grasper.surface, thumb)
            states = [simulation.joint_state for _ in simulation.frames(targets, set(steps.tolist()))]
            joints, velocities = map(np.array, zip(*states, strict=True))
            links = hand.forward(pose, joints)
            position, rotation = hand.sensor_frames(links)
            links[..., :3, 3] += OBJECT_POSITION
            records[number] = time, joints, velocities, links, position + OBJECT_POSITION, rotation
    names = ("time", "joint_positions", "joint_velocities", "link_pose", "sensor_position", "sensor_rotation")
    if len(records) == len(palms):
        stacked = [np.stack(each) for each in zip(*(records[number] for number in range(len(palms))), strict=True)]
        frames = dict(zip(names, stacked, strict=True))
        if all((frames[name][:, -1] == kept[name]).all() for name in names if name in kept):
            return frames
    raise DamagedFile(
        "closing again does not give the stored grasps bit for bit: they were made with another version of an engine, "
        f"or on another kind of processor; {remedy}"
    )
