"""The study of frames: no error with every state; between frames that of numpy's interpolation."""

import numpy as np
import trimesh

from palpate.grasp import Grasper
from palpate.hand import allegro
from studies.error_vs_runtime.frames import COUNTS, FramesStudy, record
from studies.grasping import find_closings


def test_errors_are_those_of_interpolation():
    mesh = trimesh.creation.box((0.06, 0.09, 0.3))
    points = trimesh.sample.sample_surface(mesh, 3000, seed=0)[0]
    grasper = Grasper(mesh, mesh, points, allegro())
    case = grasper, find_closings(grasper, np.random.default_rng(0), 2), np.empty(0)
    states, position = record(101, case)
    case = *case[:2], position
    study = FramesStudy(settings={"frames": {"count": 20}})
    errors = [study.errors(case, record(count, case))["sensor between frames"] for count in COUNTS]
    assert errors == sorted(errors, reverse=True) and errors[-1] == 0 < errors[-2] < 1
    steps, frames = record(5, case)
    flat = frames.reshape(2, 5, -1)
    between = [[np.interp(states, steps, column) for column in closing.T] for closing in flat]
    difference = np.moveaxis(between, 2, 1).reshape(position.shape) - position
    np.testing.assert_allclose(errors[1], 1e3 * np.linalg.norm(difference, axis=-1).mean())
    assert [method.value for method in study.methods() if method.chosen] == [20]
