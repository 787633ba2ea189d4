"""Contact geometry: convex pieces of an object's surface, their error, and the time to build the engine's model.

Closings and errors are those of `studies.error_vs_runtime.grasps`. Times include all that is built for an object.
"""

from collections.abc import Callable, Iterable

import numpy as np
import trimesh

from palpate.grasp.closing import GraspSimulation
from palpate.grasp.patches import CELL, THICKNESS, surface_patches
from studies.error_vs_runtime.grasps import AT_REST, TRUE_SURFACE, Case, Closings, GraspStudy, close, face_pieces
from studies.error_vs_runtime.study import Method

CELLS = (0.015, 0.025, 0.05, 0.1, 0.2)  # m


class PatchStudy(GraspStudy):
    """Ways to cut an object's surface into convex pieces; times of pieces, model and closings.

    A run builds the model once for all attempts of an object, a few more than the closings here.
    """

    stage = "collision patches"
    units = {key: unit for key, unit in GraspStudy.units.items() if key != "joint, same motion"}
    reference = f"{AT_REST}; {TRUE_SURFACE}"
    objects = 2  # models take long

    def methods(self) -> list[Method]:
        def run(pieces: Callable[[trimesh.Trimesh], list[np.ndarray]]) -> Callable[[Case], Closings]:
            def closed(case: Case) -> Closings:
                simulation = GraspSimulation(case.hand, pieces(case.collision), self.default.timestep)
                return close(simulation, case.poses, case.targets, self.default)

            return closed

        methods = []
        for cell in sorted({*CELLS, CELL}):
            cut = run(lambda collision, cell=cell: surface_patches(collision, cell))
            methods.append(Method("patches", "cell, mm", round(1e3 * cell, 6), cut, cell == CELL))
        methods.append(
            Method("a piece a face", "pieces", "faces", run(lambda collision: face_pieces(collision, THICKNESS)))
        )
        methods.append(Method("convex hull", "pieces", "1", run(lambda collision: [collision.vertices])))
        return methods

    def errors(self, case: Case, result: Closings) -> dict[str, float]:
        return {key: value for key, value in super().errors(case, result).items() if key in self.units}

    def _knobs(self) -> Iterable:
        """None: models are built while they are timed."""
        return ()


study = PatchStudy
