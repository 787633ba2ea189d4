"""The study of grasps across an object: more pairs find no worse grasps, and all is of pairs that are placed."""

import trimesh

from palpate.grasp.antipodal import AntipodalGrasper
from studies.error_vs_runtime.across import COUNTS, GRIP, GRIPPER, AcrossStudy, attempts


def test_the_best_grasp_is_that_of_all_pairs():
    bar = trimesh.creation.capsule(0.1, 0.015)
    points = trimesh.sample.sample_surface(bar, 2000, seed=0)[0]
    hold = {"friction": 0.8, "density": 100.0, "distance": 0.02, "duration": 0.2}
    case = AntipodalGrasper(bar, bar, points, GRIPPER, hold=hold, only_held=True, grip=GRIP)
    study = AcrossStudy(settings={"hold": {}})
    study.best = attempts(COUNTS[2], case).best
    few, more = (attempts(count, case) for count in COUNTS[1:3])
    assert few.placed <= COUNTS[1] and 0 < few.held <= few.placed
    assert few.best <= more.best and study.errors(case, more) == {
        "best wrench ball, off the best of all": 0,
        "do not hold": 100 * (1 - more.held / more.placed),
    }
    assert [method.value for method in study.methods()] == list(COUNTS)
