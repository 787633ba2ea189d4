"""Grasps across an object: pairs of points that are tried against the grasps that hold and the best quality.

Objects are scaled to 0.15 m, for the gripper of `config/hands`.
"""

from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from palpate import store
from palpate.batch import generator
from palpate.grasp.antipodal import AntipodalGrasper
from palpate.grasp.contacts import wrench_radius
from palpate.grasp.grasp import BLOCKED, Grasp
from palpate.hand import from_mjcf
from palpate.mesh import OBJECT_POSITION, load_collision, load_visual
from studies.error_vs_runtime.study import Method, Study, variants
from studies.subjects import Subject

GRIPPER = from_mjcf(*(Path(__file__).parents[2] / "config/hands" / name for name in ("wsg50.xml", "wsg50.yaml")))
SIZE, GRIP, CHOSEN = 0.15, 10.0, 20  # m across; N; pairs of the default of the figure
COUNTS = (2, 5, 10, 20, 40)


class Tried(NamedTuple):
    """Attempts with a free pose, those that hold, and the largest radius of their wrench balls, N."""

    placed: int
    held: int
    best: float


def attempts(count: int, grasper: AntipodalGrasper) -> Tried:
    """Try a number of pairs."""
    rng = generator(0, "pairs")
    results = [grasper.attempt(rng) for _ in range(count)]
    held, simulation = [each for each in results if isinstance(each, Grasp)], grasper.loose_simulation
    length = np.linalg.norm(grasper.collision.vertices - simulation.body.centre, axis=1).max()
    radii = [0.0]
    for grasp in held:
        pressed = simulation.pressed(grasp.palm_pose, grasp.joint_positions, grasp.more["servo_positions"])
        radii.append(wrench_radius(pressed, grasper.hold["friction"], simulation.body.centre, length))
    return Tried(sum(each != BLOCKED for each in results if isinstance(each, str)) + len(held), len(held), max(radii))


class AcrossStudy(Study):
    """Numbers of pairs. settings: `hold` of the config."""

    stage = "antipodal grasps"
    units = {"best wrench ball, off the best of all": "N", "do not hold": "% of those placed"}
    reference = f"the best radius of {max(COUNTS)} pairs"

    def case(self, subject: Subject) -> AntipodalGrasper:
        visual, collision = load_visual(subject.folder), load_collision(subject.folder)
        surface = store.read(Path(self.run) / f"surface/{subject.batch}.zarr", "object", "points")
        points = surface["points"][surface["object"].tolist().index(subject.name)].astype(float) - OBJECT_POSITION
        scale = SIZE / np.linalg.norm(visual.extents)
        visual.apply_scale(scale), collision.apply_scale(scale)
        self.best = None
        return AntipodalGrasper(
            visual, collision, scale * points, GRIPPER, hold=self.settings["hold"], only_held=True, grip=GRIP
        )

    def methods(self) -> list[Method]:
        return variants("antipodal", "pairs", COUNTS, partial(partial, attempts), CHOSEN)

    def errors(self, case: AntipodalGrasper, result: Tried) -> dict[str, float]:
        if self.best is None:
            self.best = attempts(max(COUNTS), case).best
        lost = 100 * (1 - result.held / result.placed) if result.placed else float("nan")
        return dict(zip(self.units, (self.best - result.best, lost), strict=True))


study = AcrossStudy
