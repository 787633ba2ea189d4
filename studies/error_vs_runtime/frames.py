"""Frames of closings: how far sensors are from where interpolation between frames puts them, against time with touch.

The engine's model is built before the clock starts.
"""

from functools import partial

import numpy as np

from palpate.batch import generator
from palpate.grasp import Grasper
from palpate.grasp.frames import frame_steps
from studies.error_vs_runtime.study import Method, Study, variants
from studies.grasping import Closing, find_closings, grasper_of
from studies.subjects import Subject

CLOSINGS = 5  # of an object
COUNTS = (2, 5, 10, 20, 40, 101)
Case = tuple[Grasper, list[Closing], np.ndarray]  # an object's closings, and sensors' positions in every state


def record(count: int, case: Case) -> tuple[np.ndarray, np.ndarray]:
    """Steps (f,) of the frames of each closing, and the sensors' positions (n, f, s, 3), m; depth is traced as well."""
    grasper, closings, _ = case
    steps, places = frame_steps(count, grasper.simulation.steps), []
    for pose, targets in closings:
        grasper.simulation.place(pose, grasper.hand.open_joint_positions)
        states = grasper.simulation.frames(targets, set(steps.tolist()))
        joints = np.array([grasper.simulation.joint_state[0] for _ in states])
        position, rotation = grasper.hand.sensor_frames(grasper.hand.forward(pose, joints))
        near = grasper.caster.is_near(position, rotation)
        grasper.caster.trace(position[near], rotation[near])
        places.append(position)
    return steps, np.array(places)


class FramesStudy(Study):
    """Numbers of frames. settings: `frames` of the config."""

    stage = "frames"
    units = {"sensor between frames": "mm"}
    reference = "every state of the closing; between frames sensors move on straight lines"

    def case(self, subject: Subject) -> Case:
        """Some closings of the object, and sensors' positions in every state of them."""
        grasper = grasper_of(self.run, subject)
        closings = find_closings(grasper, generator(0, subject.name, "frames study"), CLOSINGS)
        return grasper, closings, record(grasper.simulation.steps + 1, (grasper, closings, np.empty(0)))[1]

    def methods(self) -> list[Method]:
        """Several numbers of frames."""
        return variants("closing", "frames", COUNTS, partial(partial, record), self.settings["frames"]["count"])

    def errors(self, case: Case, result: tuple[np.ndarray, np.ndarray]) -> dict[str, float]:
        """Mean over states, sensors and closings."""
        (steps, position), states = result, np.arange(case[2].shape[1])
        after = np.searchsorted(steps, states, side="right").clip(1, len(steps) - 1)
        share = ((states - steps[after - 1]) / (steps[after] - steps[after - 1]))[:, None, None]
        between = (1 - share) * position[:, after - 1] + share * position[:, after]
        return {"sensor between frames": 1e3 * float(np.linalg.norm(between - case[2], axis=-1).mean())}


study = FramesStudy
